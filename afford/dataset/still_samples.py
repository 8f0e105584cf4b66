"""Samples drawn from rendered stills: each sample shows one of the valid modes of a task."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from schemas.affordance import Sample, Samples
from schemas.scene import Mode, Still, Stills

MOTION_TIME_NS = np.zeros(1, np.int64)
"""Time of the single motion point of a still, ns."""


def sample_stills(stills: Stills, draws: int, seed: int) -> Samples:
    """Draw up to `draws` samples of each still. Raises ValueError when `draws` is less than 1."""
    if draws < 1:
        raise ValueError(f"draws: expected 1 or more, got {draws}")
    found = tuple(sample for still in stills.stills for sample in _drawn(stills, still, draws, seed))
    return Samples(stills.video_id, stills.video_id, stills.participant_id, stills.split, stills.width_px, stills.height_px,
                   found, ())


def _drawn(stills: Stills, still: Still, draws: int, seed: int) -> Iterator[Sample]:
    rng = np.random.default_rng([seed, zlib.crc32(stills.video_id.encode()), still.number])
    share = [mode.weight for mode in still.modes]
    for n, k in enumerate(rng.choice(len(still.modes), min(draws, len(still.modes)), replace=False, p=share)):
        yield _sample(stills, still, still.modes[int(k)], n + 1)


def _sample(stills: Stills, still: Still, mode: Mode, draw: int) -> Sample:
    frame = still.image + 1
    return Sample(
        sample_id=f"{stills.video_id}_{frame:010d}_{still.narration.narration_id}_{draw}",
        frame=frame,
        time_ns=still.image * 1_000_000_000,
        image_jpeg=stills.images[still.image].jpeg,
        masks=mode.masks,
        object_left=mode.objects[0],
        object_right=mode.objects[1],
        narration=still.narration,
        taxonomy=mode.taxonomy,
        quality=1.0,
        inpaint_confidence=1.0,
        key_frame=frame,
        key_distance=0,
        motion=np.stack([_centre(mask) for mask in mode.masks])[:, None],
        motion_time_ns=MOTION_TIME_NS,
    )


def _centre(mask: np.ndarray) -> np.ndarray:
    """Return the centroid (2,) float32 x, y of a mask, px; NaN for an empty one."""
    y, x = np.nonzero(mask)
    return np.array([x.mean(), y.mean()] if x.size else [np.nan, np.nan], np.float32)
