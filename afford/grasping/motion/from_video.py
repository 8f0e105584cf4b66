"""Hand motion from video: runs of tracked keypoints, resampled evenly in a world with z up, with phases and the touched object.

The pose of the camera is unknown. The world is the camera's, turned by an assumed pitch; its lowest keypoint is at z = 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from afford.grasping.motion.clip_rules import behind_back
from schemas.hand import PHASES, HandMotion
from schemas.hands import HandTracks, MotionRemarks, VideoMotions
from schemas.video import NOT_IN_CONTACT, SIDES, UNKNOWN_CONTACT, Annotation, Clip, Hand

UNKNOWN, REACH, CLOSE, HOLD, LIFT = (PHASES.index(name) for name in ("unknown", "reach", "close", "hold", "lift"))
UNNAMED = "object"
"""name of an object without narration"""
LOWEST = 2.0
"""percentile of the heights of keypoints that is z = 0"""
OPPOSING = (8, 12)
"""tips of index and middle finger"""
NO_TOUCH, TOUCH, NOT_KNOWN = 0, 1, -1


@dataclass(frozen=True)
class VideoMotionOptions:
    """Options of `video_motions`, as in the parameters of hand_motion."""

    rate_hz: float
    min_s: float
    max_gap_s: float
    min_confidence: float
    max_bent_back_m: float
    min_contact: float
    key_s: float
    pitch_deg: float
    close_s: float
    lift_m: float
    slow_m_s: float


def video_motions(hands: HandTracks, clip: Clip, options: VideoMotionOptions) -> VideoMotions:
    """Split the two hands of a clip into motions. Runs that are too short or uncertain become remarks."""
    parts = [(side, run) for row, side in enumerate(SIDES) for run in _runs(hands, row, options)]
    long = [(side, run) for side, run in parts if _lasts(hands, run, options)]
    remarks = [text for side in SIDES for text in _remarks(hands, side, parts, long, options)]
    if not long:
        return VideoMotions(MotionRemarks(hands.clip_id, tuple(remarks)), ())
    world = {row: hands.keypoints_m[row].astype(float) @ camera_axes(options.pitch_deg).T for row in range(2)}
    floor = np.percentile(np.concatenate([world[SIDES.index(side)][run][..., 2].ravel() for side, run in long]), LOWEST)
    numbers: Counter[str] = Counter()
    motions = []
    for side, run in long:
        numbers[side] += 1
        points = world[SIDES.index(side)][run] - np.array([0, 0, floor])
        motions.append(_motion(f"{hands.clip_id}-{side}-{numbers[side]:02d}", side, points, hands, run, clip, options))
    return VideoMotions(MotionRemarks(hands.clip_id, tuple(remarks)), tuple(motions))


def camera_axes(pitch_deg: float) -> np.ndarray:
    """Return R_world_camera (3, 3) of a camera that looks down by `pitch_deg`: world x right, y away, z up."""
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    return np.array([[1.0, 0, 0], [0, -s, c], [0, -c, -s]])


def phases(points: np.ndarray, touch: np.ndarray, rate_hz: float, options: VideoMotionOptions) -> np.ndarray:
    """Compute the phase (t,) uint8 of keypoints (t, 21, 3) from contact (t,), which is TOUCH, NO_TOUCH or NOT_KNOWN.

    During contact the phase is hold, and lift once the palm has risen by `lift_m`. Before a contact, fingers close from their
    last widest opening within `close_s`; a hand that moves is reaching. Everything else is unknown.
    """
    out = np.full(len(points), UNKNOWN, np.uint8)
    palm, wide = points[:, [0, 5, 9, 13, 17]].mean(axis=1), _aperture(points)
    speed = np.linalg.norm(np.gradient(palm, axis=0), axis=-1) * rate_hz if len(palm) > 1 else np.zeros(len(palm))
    free = 0
    for run in _stretches(touch == TOUCH):
        out[run] = np.where(palm[run, 2] - palm[run[0], 2] > options.lift_m, LIFT, HOLD)
        before = np.arange(free, run[0])
        before = before[touch[before] == NO_TOUCH]
        if len(before) and before[-1] == run[0] - 1:
            near = before[before >= run[0] - round(options.close_s * rate_hz)]
            start = near[len(near) - 1 - int(np.argmax(wide[near][::-1]))] if len(near) else run[0]
            out[before] = np.where(before >= start, CLOSE, np.where(speed[before] > options.slow_m_s, REACH, UNKNOWN))
        free = int(run[-1]) + 1
    return out


def _runs(hands: HandTracks, row: int, options: VideoMotionOptions) -> list[np.ndarray]:
    """Return the frames of each uninterrupted run of one hand. Frames with fingers that bend backwards are left out."""
    possible = behind_back(hands.keypoints_m[row].astype(float), SIDES[row]).mean(axis=1) <= options.max_bent_back_m
    sure = np.flatnonzero(possible & (hands.confidence[row].mean(axis=1) >= options.min_confidence))
    gaps = np.diff(hands.time_ns[sure]) > options.max_gap_s * 1e9
    return [run for run in np.split(sure, np.flatnonzero(gaps) + 1) if len(run)]


def _lasts(hands: HandTracks, run: np.ndarray, options: VideoMotionOptions) -> bool:
    return len(run) > 2 and (hands.time_ns[run[-1]] - hands.time_ns[run[0]]) / 1e9 >= options.min_s


Parts = Sequence[tuple[Hand, np.ndarray]]


def _remarks(hands: HandTracks, side: Hand, parts: Parts, long: Parts, options: VideoMotionOptions) -> list[str]:
    """Say which frames of a hand give no motion."""
    row = SIDES.index(side)
    shown, some = int(hands.seen[row].sum()), int((hands.confidence[row] > 0).any(axis=1).sum())
    runs, kept = ([run for name, run in those if name == side] for those in (parts, long))
    if not shown and not some:
        return []
    if not runs:
        why = (f"the confidence of its keypoints is below {options.min_confidence:g}, or its fingers bend backwards" if some else
               "it has no landmarks")
        return [f"no motion of the {side} hand, which is in {max(shown, some)} frames: {why}"]
    if len(runs) == len(kept):
        return []
    return [f"{len(runs) - len(kept)} of {len(runs)} runs of the {side} hand are shorter than {options.min_s:g} s and left out"]


def _motion(name: str, side: Hand, points: np.ndarray, hands: HandTracks, run: np.ndarray, clip: Clip,
            options: VideoMotionOptions) -> HandMotion:  # fmt: skip
    """Resample one run of keypoints (t, 21, 3), in the world, at an even rate."""
    time_s = hands.time_ns[run] / 1e9
    even = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) * options.rate_hz + 1e-6) + 1) / options.rate_hz
    keypoints = PchipInterpolator(time_s, points, axis=0)(np.minimum(even, time_s[-1]))
    touch, names = _contact(side, hands, run, clip, options)
    nearest = np.abs(even[:, None] - time_s[None]).argmin(axis=1)
    known = names.most_common(1)[0][0] if names else ""
    return HandMotion(name, "video", side, options.rate_hz, keypoints, phases(keypoints, touch[nearest], options.rate_hz, options),
                      known, np.zeros((0, 7)), np.zeros((0, 4, 4)))


def _contact(side: Hand, hands: HandTracks, run: np.ndarray, clip: Clip,
             options: VideoMotionOptions) -> tuple[np.ndarray, Counter[str]]:  # fmt: skip
    """Return the contact (t,) of the frames of a run, and how often each named object is touched in its key frames.

    Fingers decide; where no finger is known to touch, the nearest key frame within `key_s` does.
    """
    fingers = hands.finger_contact[SIDES.index(side), run]
    touch = np.where(fingers.max(axis=1) >= options.min_contact, TOUCH, np.where(fingers.any(axis=1), NO_TOUCH, NOT_KNOWN))
    keys = [(key.frame, *_touched(key.annotations, side)) for key in clip.key_frames]
    frames, found = np.array([key[0] for key in keys], np.int64), [key[1] for key in keys]
    if len(frames):
        near = np.abs(hands.frame[run][:, None] - frames[None])
        said = np.array(found)[near.argmin(axis=1)]
        touch = np.where((touch == NOT_KNOWN) & (near.min(axis=1) <= options.key_s * clip.fps), said, touch)
    during = [name for frame, state, name in keys if state == TOUCH and hands.frame[run[0]] <= frame <= hands.frame[run[-1]]]
    return touch, Counter(name for name in during if name.partition(":")[0] != UNNAMED)


def _touched(annotations: Sequence[Annotation], side: Hand) -> tuple[int, str]:
    """Return the contact of a hand in one key frame, and the name of the touched object."""
    hand = next((one for one in annotations if one.side == side), None)
    if hand is None or hand.contact in UNKNOWN_CONTACT:
        return NOT_KNOWN, ""
    if hand.contact in NOT_IN_CONTACT:
        return NO_TOUCH, ""
    return TOUCH, next((one.name for one in annotations if one.annotation_id == hand.contact), UNNAMED)


def _aperture(points: np.ndarray) -> np.ndarray:
    """Return the distance (t,) from the thumb's tip to the middle of the opposing fingertips."""
    wide: np.ndarray = np.linalg.norm(points[:, OPPOSING].mean(axis=1) - points[:, 4], axis=-1)
    return wide


def _stretches(mask: np.ndarray) -> list[np.ndarray]:
    """Return the indices of each uninterrupted stretch of true values."""
    at = np.flatnonzero(mask)
    return [part for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(part)]
