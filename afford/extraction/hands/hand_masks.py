"""Masks of hands from their landmarks: shape, the colours of the clip, and motion, also across frames without landmarks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from afford.extraction.hands.colours import ClipColours
from afford.extraction.hands.landmark_tracks import HandPoints, LandmarkTrack
from afford.extraction.hands.motion import SampledFrames
from afford.extraction.hands.refine import guided_filter
from afford.extraction.landmarks.geometry import distance_from, draw_forearm, draw_hand, hand_size

CORE, OUTLINE = 0.03, 0.1
"""radius of the bones whose pixels certainly show the hand, and of those from which distances count, in sizes of the hand"""
FINGER = 0.13
"""radius of a finger"""
CERTAIN, INSIDE, EDGE, SLOPE, FARTHEST, FOREARM = 2.5, 1.5, 0.0, 12.0, -5.0, 0.3
"""log odds of a hand by place: on the bones, within the fingers, at their edge; their fall per size of the hand beyond, down to
`FARTHEST`; in the region of the forearm"""
NEAR, AROUND = 0.45, 2.5
"""distances from the bones between which pixels are the surroundings of a hand, in sizes of the hand"""
KEPT, KEPT_ODDS = 0.6, -0.3
"""where the previous frame was a hand with this probability, place counts as little against it"""
LANDMARK_MEMORY, MEMORY, COLOUR = 0.6, 1.0, 0.9
"""weight of the previous frame with landmarks; weights of the previous frame and of colour without them"""
BAND_PX = 7
"""motion between sampled frames that optical flow may miss, where there are no landmarks"""
BEYOND = 4
"""sampled frames for which a hand is followed beyond the first and the last landmarks"""
AGREE = 0.25
"""least IoU of the masks that were followed forwards and backwards through a gap"""
SHRINK, GROW = 0.25, 2.5
"""range of the area of a followed hand, relative to that with landmarks"""
LEAST_PX = 60
BESIDE = 0.5
"""distance from a hand within which other certain components belong to it, as the forearm behind a watch, in sizes of the hand"""
ROUNDS = 2
TURNS_RAD = np.radians((0, -12, 12, -24, 24, -36, 36, -48, 48))
"""angles by which a wrist may be bent"""
TURN_COST, ARM_ODDS = 0.6, 1.5
"""cost of the largest angle against a forearm of full odds as long as a hand; limit of the odds of its pixels"""


@dataclass
class MaskedTrack:
    """A hand over time: landmarks, and a mask wherever it was followed."""

    track: LandmarkTrack
    odds: np.ndarray
    """(n,) float32 log odds of every colour bin"""
    masks: dict[int, np.ndarray] = field(default_factory=dict)
    """sampled frame -> (h, w) bool"""


def hand_masks(
    tracks: Sequence[LandmarkTrack], sampled: SampledFrames, extra: np.ndarray | None, min_contrast: float
) -> list[MaskedTrack]:
    """Segment the hands of landmark tracks in every sampled frame, most evidence first; masks do not overlap.

    extra: log odds (k, h, w) of a hand from the hand finder, or None. min_contrast: least mean log odds of the colours on a hand's
    bones; with less, a track is no hand.
    """
    if not tracks:
        return []
    shape = (sampled.rgb.shape[1], sampled.rgb.shape[2])
    near = np.zeros(sampled.rgb.shape[:3], bool)
    for track in tracks:
        for k, one in track.found.items():
            near[k] |= (_away(shape, one) < NEAR) | draw_forearm(shape, one.points_px)
    colours = ClipColours(sampled.rgb, ~near)
    out = [MaskedTrack(track, _core_odds(track, colours, near)) for track in tracks]
    out = [one for one in out if _contrast(one, colours) >= min_contrast]
    for _ in range(ROUNDS):
        _learn_colours(out, colours, near)
    probabilities = [_followed(one, sampled, colours, extra) for one in out]
    for n, masked in enumerate(out):
        for k, p in probabilities[n].items():
            mask = guided_filter(p.astype(np.float32), sampled.rgb[k], 3) > 0.5
            _separate(mask, k, masked, out[:n])
            if (clean := _clean(mask, p, masked.track.found.get(k))) is not None:
                masked.masks[k] = clean
    return out


def _away(shape: tuple[int, int], one: HandPoints) -> np.ndarray:
    """Distance (h, w) from the bones, in sizes of the hand."""
    return distance_from(draw_hand(shape, one.points_px, OUTLINE)) / hand_size(one.points_px)


def wrist_turn(points_px: np.ndarray, odds: np.ndarray) -> float:
    """Estimate the angle of the forearm against the hand, rad, from the colour odds (h, w) along possible forearms."""
    limited, scores = np.clip(odds, -ARM_ODDS, ARM_ODDS), []
    for turn in TURNS_RAD:
        strip = draw_forearm(odds.shape, points_px, float(turn), 1.0)
        scores.append(limited[strip].sum() / hand_size(points_px) ** 2 - TURN_COST * (turn / TURNS_RAD.max()) ** 2)
    return float(TURNS_RAD[int(np.argmax(scores))]) if max(scores) > 0 else 0.0


def place_odds(shape: tuple[int, int], points_px: np.ndarray, turn_rad: float = 0.0) -> np.ndarray:
    """Log odds (h, w) float32 of a hand with keypoints (21, 2) and the angle of its forearm, by place alone."""
    fingers = draw_hand(shape, points_px, FINGER)
    away = distance_from(fingers) / hand_size(points_px)
    odds = np.where(fingers, INSIDE, np.maximum(EDGE - SLOPE * away, FARTHEST))
    odds = np.where(draw_hand(shape, points_px, CORE), CERTAIN, odds)
    return np.where(draw_forearm(shape, points_px, turn_rad), np.maximum(odds, FOREARM), odds).astype(np.float32)


def _core_odds(track: LandmarkTrack, colours: ClipColours, near: np.ndarray) -> np.ndarray:
    """Colour odds from the pixels on the bones."""
    shape = near.shape[1:]
    hand, around = np.zeros(0), np.zeros(0)
    for k, one in track.found.items():
        core = draw_hand(shape, one.points_px, CORE) * one.presence
        hand = _plus(hand, colours.counts(colours.bins[k], core))
        around = _plus(around, colours.counts(colours.bins[k], _surroundings(one, near[k])))
    return colours.odds(hand, around)


def _plus(total: np.ndarray, counts: np.ndarray) -> np.ndarray:
    return counts if not len(total) else total + counts


def _surroundings(one: HandPoints, near: np.ndarray) -> np.ndarray:
    away = _away(near.shape, one)
    return ((away > NEAR) & (away < AROUND) & ~near).astype(np.float32)


def _contrast(one: MaskedTrack, colours: ClipColours) -> float:
    """Mean colour odds on the bones: low where the colours of the supposed hand are everywhere around it."""
    shape = colours.bins.shape[1:]
    means = [float(one.odds[colours.bins[k]][core].mean()) for k, points in one.track.found.items()
             if (core := draw_hand(shape, points.points_px, CORE)).any()]  # fmt: skip
    return float(np.mean(means)) if means else 0.0


def _learn_colours(tracks: Sequence[MaskedTrack], colours: ClipColours, near: np.ndarray) -> None:
    """Learn the colours of every hand from the pixels that are probable by now, with those of all hands as a prior."""
    sums = []
    for one in tracks:
        hand, around = np.zeros(0), np.zeros(0)
        for k, points in one.track.found.items():
            p = _sigmoid(place_odds(near.shape[1:], points.points_px) + one.odds[colours.bins[k]])
            sure = np.where(p > 0.8, p, 0) * (_away(near.shape[1:], points) < 0.2)
            hand = _plus(hand, colours.counts(colours.bins[k], sure))
            around = _plus(around, colours.counts(colours.bins[k], _surroundings(points, near[k])))
        sums.append((hand, around))
    if not sums:
        return
    shared = colours.odds(np.sum([hand for hand, _ in sums], 0), np.sum([around for _, around in sums], 0))
    for one, counts in zip(tracks, sums, strict=True):
        own = len(one.track.found) / (len(one.track.found) + 4)
        one.odds = (own * colours.odds(*counts) + (1 - own) * shared).astype(np.float32)


def _followed(one: MaskedTrack, sampled: SampledFrames, colours: ClipColours, extra: np.ndarray | None) -> dict[int, np.ndarray]:
    """Probabilities (h, w) float16 of a hand in all sampled frames in which it is seen or followed."""
    seen = sorted(one.track.found)
    ahead, back = (dict(_direction(one, sampled, colours, extra, step)) for step in (1, -1))
    out = {}
    for k in sorted(ahead.keys() | back.keys()):
        both = [side[k] for side in (ahead, back) if k in side]
        if k not in one.track.found and seen[0] < k < seen[-1]:
            after = int(np.searchsorted(seen, k))
            gaps = (k - seen[after - 1], seen[after] - k)
            if len(both) < 2 or not _agree(*both):
                if min(gaps) > BEYOND:
                    continue
                both = both if len(both) < 2 else [both[int(gaps[0] > gaps[1])]]
        out[k] = np.mean(both, axis=0).astype(np.float16)
    return out


def _agree(one: np.ndarray, other: np.ndarray) -> bool:
    a, b = one > 0.5, other > 0.5
    return bool((a & b).sum() >= AGREE * max(int((a | b).sum()), 1))


def _direction(
    one: MaskedTrack, sampled: SampledFrames, colours: ClipColours, extra: np.ndarray | None, step: int
) -> Iterator[tuple[int, np.ndarray]]:
    """Follow a hand in one direction of time, from its first landmarks until it is lost beyond the last."""
    seen, count = sorted(one.track.found), len(sampled.at)
    before, area, lost = None, 0, 0
    for k in range(seen[0], count) if step == 1 else range(seen[-1], -1, -1):
        moved = None if before is None else sampled.warp(before, k, step)
        colour = one.odds[colours.bins[k]]
        more = 0.0 if extra is None else extra[k].astype(np.float32)
        if k in one.track.found:
            points = one.track.found[k].points_px
            place = place_odds(colour.shape, points, wrist_turn(points, colour))
            if moved is not None:
                place = np.where(moved > KEPT, np.maximum(place, KEPT_ODDS), place) + LANDMARK_MEMORY * _logit(moved, 3.0)
            before = _sigmoid(place + colour + more)
            area, lost = int((before > 0.5).sum()), 0
        elif moved is not None:
            lost += 1
            band = cv2.dilate((moved > 0.5).astype(np.uint8), np.ones((BAND_PX, BAND_PX), np.uint8)) > 0
            before = _sigmoid(np.where(band, MEMORY * _logit(moved, 2.5), -4) + COLOUR * colour + more)
            mask = before > 0.5
            inside = seen[0] < k < seen[-1]
            plausible = mask.sum() >= LEAST_PX and SHRINK * area < mask.sum() < GROW * area and colour[mask].mean() >= 0.8
            if not plausible or (not inside and lost > BEYOND):
                before = None
        else:
            before = None
        if before is not None:
            yield k, before


def _logit(p: np.ndarray, limit: float) -> np.ndarray:
    return np.clip(np.log((p + 0.02) / (1.02 - p)), -limit, limit)


def _sigmoid(odds: np.ndarray) -> np.ndarray:
    return np.asarray(1 / (1 + np.exp(-odds)), np.float32)


def _separate(mask: np.ndarray, k: int, one: MaskedTrack, others: Sequence[MaskedTrack]) -> None:
    """Share pixels with tracks of more evidence: each pixel belongs to the nearer hand, or to the other where one is not seen."""
    for other in others:
        if k not in other.masks:
            continue
        common = mask & other.masks[k]
        mine, theirs = one.track.found.get(k), other.track.found.get(k)
        if mine is not None and theirs is not None:
            nearer = _away(mask.shape, mine) < _away(mask.shape, theirs)
            other.masks[k] &= ~(common & nearer)
            mask &= ~(common & ~nearer)
        else:
            mask &= ~common


def _clean(mask: np.ndarray, p: np.ndarray, found: HandPoints | None) -> np.ndarray | None:
    """Keep the components that belong to the hand: those on its bones, and large certain ones; None when too little is left."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, label, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if count < 2:
        return None
    areas = stats[:, cv2.CC_STAT_AREA]
    if found is None:
        kept = [1 + int(np.argmax(areas[1:]))]
    else:
        core = draw_hand(mask.shape, found.points_px, CORE)
        on_bones = np.bincount(label[core], minlength=count)
        on_bones[0] = 0
        if on_bones.sum() < 0.25 * core.sum():
            return None
        kept = np.flatnonzero(on_bones > 0.1 * on_bones.sum()).tolist()
        near = distance_from(np.isin(label, kept)) < BESIDE * hand_size(found.points_px)
        kept += [i for i in range(1, count) if i not in kept and areas[i] > LEAST_PX and p[label == i].mean() > 0.75
                 and near[label == i].any()]  # fmt: skip
    out = np.isin(label, kept)
    return out if out.sum() >= LEAST_PX else None
