"""What of one look is a hand, and which side a followed hand has: it has one side all its life."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.hands.part_tracks import Piece, Track
from afford.extraction.hands.refine import pieces
from schemas.video import SIDES, Hand

BLUR_PX = 6.0
"""over which it is averaged what side a pixel has"""
SURE = 0.3
"""lean from which a part is sure of its side"""
RESTING, PACE_PX = 0.05, 1.0
"""what a pixel that rests counts as a hand's, against one that moves by so much (px of half the size) from look to look"""


@dataclass(frozen=True)
class Bearing:
    """What is told of a hand's side by where it is."""

    facing: bool
    """the person is seen from the front: the left hand is on the right, and arms come from above"""
    order: float
    """what it counts for a left hand to be to the left of another hand, against a sure look"""
    entry: float
    """what it counts where the arm comes into the picture"""

    @property
    def sign(self) -> int:
        return -1 if self.facing else 1

    def enters(self, mask: np.ndarray) -> float:
        """From -1, at the person's right, to 1, at the left: where a part (h, w) leaves the picture; 0 where it does not."""
        width = mask.shape[1]
        near, far = (mask[0], mask[-1]) if self.facing else (mask[-1], mask[0])
        across = [np.flatnonzero(near), np.zeros(mask[:, 0].sum()), np.full(mask[:, -1].sum(), width - 1)]
        x = np.concatenate(across) if sum(map(len, across)) else np.flatnonzero(far)
        return float(self.sign * np.clip(2 - 4 * x.mean() / (width - 1), -1, 1)) if len(x) else 0.0


def hands_of(p: np.ndarray, left: np.ndarray, right: np.ndarray, speed_px: np.ndarray, least_px: float, least_part: float,
             bearing: Bearing) -> list[Piece]:  # fmt: skip
    """The hands of one look. Two that touch are parted where the side changes, if both are sure of it and each is at least
    `least_part` of both.

    p: (h, w) probability of a hand; left, right: (h, w) of each side, as the finder has it; speed_px: (h, w) motion of its own.
    """
    weight = (p - 0.5) * (RESTING + (1 - RESTING) * np.minimum(speed_px / PACE_PX, 1))
    lean = _lean(left, right)
    found: list[Piece] = []
    for part in pieces(p > 0.5, least_px):
        halves = [part & (lean > 0), part & (lean <= 0)]
        two = all(half.sum() >= least_part * part.sum() and abs(lean[half].mean()) >= SURE for half in halves)
        for one in map(_largest, halves) if two else [part]:
            if one.sum() >= least_px:
                side = float(lean[one].mean()) + bearing.entry * bearing.enters(one)
                found.append(Piece(one, side, float(weight[one].sum())))
    return found


def _lean(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(h, w) float32 from -1 to 1."""
    less, more = (cv2.GaussianBlur(one.astype(np.float32), (0, 0), BLUR_PX) for one in (left - right, left + right))
    return less / np.maximum(more, 1e-3)


def _largest(mask: np.ndarray) -> np.ndarray:
    return max(pieces(mask, 1), key=np.count_nonzero, default=mask)


def usual(tracks: Sequence[Track], least: dict[int, int], share: float) -> list[Track]:
    """Tracks that were seen as often as `least` says (by their first look), and grew to at least `share` of the usual size of a
    hand in this clip: what is much smaller, before the same camera, is none.
    """
    often = [track for track in tracks if track.times_seen >= least[min(track.pieces)]]
    largest: dict[int, int] = {}
    for track in often:
        for k, piece in track.pieces.items():
            largest[k] = max(largest.get(k, 0), int(piece.mask.sum()))
    size = float(np.median(list(largest.values()))) if largest else 0.0
    return [track for track in often if track.largest_px >= share * size]


def sided(tracks: Sequence[Track], bearing: Bearing, near_px: float) -> dict[Hand, list[Track]]:
    """Tracks by side. Each votes with all its looks; what is most of a hand, and surest of a side, comes first. What finds its side
    taken is another part of the same hand where they are near and both sure, else it has the other side where that is free; a third
    at a time is no hand meanwhile.
    """
    leans = [float(np.clip(np.mean(_votes(track, tracks, bearing.sign * bearing.order)), -1, 1)) for track in tracks]
    bids = [(-track.mass * (1 + sign * lean) / 2, i, side) for i, (track, lean) in enumerate(zip(tracks, leans, strict=True))
            for side, sign in zip(SIDES, (1, -1), strict=True)]  # fmt: skip
    out: dict[Hand, list[Track]] = {side: [] for side in SIDES}
    placed = set[int]()
    for _, i, side in sorted(bids):
        alike = (leans[i] > 0) == (side == SIDES[0])
        if i not in placed and (not _meets(tracks[i], out[side]) or (alike and _same(tracks[i], out[side], near_px))):
            out[side].append(tracks[i])
            placed.add(i)
    for i, track in enumerate(tracks):
        side = SIDES[0] if leans[i] > 0 else SIDES[1]
        if i not in placed and (free := _without(track, out[side])):
            out[side].append(Track(free))
    return out


def _votes(track: Track, others: Sequence[Track], order: float) -> list[float]:
    """One for every time that the track is seen."""
    return [piece.lean + order * sum(_before(piece, other.pieces[k]) for other in others
                                     if other is not track and k in other.pieces and other.pieces[k].seen)
            for k, piece in track.pieces.items() if piece.seen]  # fmt: skip


def _before(piece: Piece, other: Piece) -> float:
    """1 for what lies to the left of another, -1 to the right."""
    x, y = (np.flatnonzero(one.mask.any(0)).mean() for one in (piece, other))
    return float(np.sign(y - x))


def _without(track: Track, others: Sequence[Track]) -> dict[int, Piece]:
    """What is left of a track at looks that have none of `others`."""
    return {k: piece for k, piece in track.pieces.items() if not any(k in other.pieces for other in others)}


def _meets(track: Track, others: Sequence[Track]) -> bool:
    return any(track.pieces.keys() & other.pieces.keys() for other in others)


def _same(track: Track, others: Sequence[Track], near_px: float) -> bool:
    """Whether a track is another part of the hand that `others` are: wherever they meet, near, and sure of the same side."""
    met = [(track.pieces[k], other.pieces[k]) for other in others for k in track.pieces.keys() & other.pieces.keys()]
    seen = [(a, b) for a, b in met if a.seen and b.seen]
    return bool(seen) and all(a.lean * b.lean > 0 and min(abs(a.lean), abs(b.lean)) >= SURE for a, b in seen) and all(
        _apart_px(a.mask, b.mask) <= near_px for a, b in seen)


def _apart_px(a: np.ndarray, b: np.ndarray) -> float:
    """Shortest distance between two masks."""
    return float(cv2.distanceTransform((~a).astype(np.uint8), cv2.DIST_L2, 3)[b].min())
