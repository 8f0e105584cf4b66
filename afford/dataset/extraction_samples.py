"""Samples of one extracted clip: selection of frames, and the image, masks, narration and motion of each sample."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from afford.common.image_files import encode_jpeg
from schemas.affordance import Affordances, FrameLabels, Rejection, Sample, Samples
from schemas.masks import CompleteObjects, Tracks
from schemas.video import SIDES, Clip, Frames, Inpainted, Narration

NS_PER_S = 1_000_000_000


def mask_centroid(mask: np.ndarray) -> np.ndarray:
    """Return the centroid (2,) float32 x, y of a mask (h, w) bool; NaN for an empty mask."""
    columns, rows = mask.sum(0), mask.sum(1)
    count = columns.sum()
    if not count:
        return np.full(2, np.nan, np.float32)
    return np.array([columns @ np.arange(columns.size) / count, rows @ np.arange(rows.size) / count], np.float32)


class MotionPaths:
    """Image paths of a clip's hands (visible masks) and objects (complete masks), from cached mask centroids.

    A step takes the frame nearest in time, at most half a step away. The point is NaN when there is no such frame (end of the
    clip, sparse frames, entity out of sight). Points are in the image of their own frame, so the paths include camera motion.
    """

    def __init__(self, tracks: Tracks, complete: CompleteObjects, time_ns: np.ndarray, motion_s: float, steps: int) -> None:
        if steps < 2 or motion_s <= 0:
            raise ValueError(f"motion needs at least 2 steps over more than 0 s, got {steps} steps over {motion_s} s")
        self.time_ns = time_ns
        self.steps_ns = np.rint(np.linspace(0, motion_s * NS_PER_S, steps)).astype(np.int64)
        masks = {entity.entity_id: tracks.masks[n] for n, entity in enumerate(tracks.entities)}
        masks |= {entity.entity_id: complete.masks[n] for n, entity in enumerate(complete.entities)}
        self.known = frozenset(masks)
        self.centroid = cache(lambda entity_id, t: mask_centroid(masks[entity_id][t]))

    def rows_after(self, t: int) -> list[int]:
        """Return the row of the frame nearest to each step after row t, -1 where none is near enough."""
        wanted = self.time_ns[t] + self.steps_ns
        right = np.searchsorted(self.time_ns, wanted).clip(0, self.time_ns.size - 1)
        left = (right - 1).clip(0)
        nearest = np.where(wanted - self.time_ns[left] < self.time_ns[right] - wanted, left, right)
        far = np.abs(self.time_ns[nearest] - wanted) > self.steps_ns[1] // 2
        return np.where(far, -1, nearest).tolist()

    def after(self, t: int, object_ids: list[str]) -> np.ndarray:
        """Return the paths (4, steps, 2) float32 px of left hand, right hand, left object and right object ('' for none)."""
        rows = self.rows_after(t)
        path = np.full((4, len(rows), 2), np.nan, np.float32)
        for n, entity_id in enumerate(["left hand", "right hand", *object_ids]):
            if entity_id in self.known:
                for step, row in enumerate(rows):
                    if row >= 0:
                        path[n, step] = self.centroid(entity_id, row)
        return path


@dataclass(frozen=True)
class Extraction:
    """Outputs of the extraction stages for one clip; row t is the same frame in all of them."""

    clip: Clip
    frames: Frames
    inpainted: Inpainted
    tracks: Tracks
    complete: CompleteObjects
    affordances: Affordances
    labels: FrameLabels

    def check(self) -> None:
        """Raise ValueError when two outputs have different frames, or a held object has no complete mask."""
        for part in (self.inpainted, self.tracks, self.complete, self.affordances):
            if not np.array_equal(part.frame, self.frames.frame):
                raise ValueError(
                    f"{self.clip.clip_id}: {type(part).__name__}.frame differs from Frames.frame "
                    f"({part.frame.size} frames, expected {self.frames.frame.size}); run the stages on the same frames")
        missing = {entity.entity_id for entity in self.affordances.objects} - {e.entity_id for e in self.complete.entities}
        if missing:
            raise ValueError(f"{self.clip.clip_id}: CompleteObjects.entities: expected the objects of Affordances, "
                             f"{', '.join(sorted(missing))} missing; run object_completion on the same tracks")


@dataclass(frozen=True)
class SamplingRule:
    """Limits on the accepted frames that become samples; 0 disables a limit."""

    stride_frames: int
    max_key_distance: int
    min_quality: float


def select_frames(x: Extraction, choice: SamplingRule) -> tuple[list[int], Counter[str]]:
    """Return the rows that become samples, and counts of the first rejection reason of all other frames."""
    reasons: Counter[str] = Counter()
    rows: list[int] = []
    labelled = set(x.labels.frame.tolist())
    for t, frame in enumerate(x.frames.frame.tolist()):
        reason = _reason(x, choice, t, frame in labelled)
        if not reason and rows and frame - int(x.frames.frame[rows[-1]]) < choice.stride_frames:
            reason = "between_strides"
        if reason:
            reasons[reason] += 1
        else:
            rows.append(t)
    return rows, reasons


def _reason(x: Extraction, choice: SamplingRule, t: int, labelled: bool) -> str:
    rejection = Rejection(int(x.affordances.rejection[t]))
    if rejection is not Rejection.ACCEPTED:
        return rejection.name.lower()
    if not labelled:
        return "no_narration"
    if choice.max_key_distance and key_frame_of(x, t)[1] > choice.max_key_distance:
        return "far_from_key_frame"
    return "below_min_quality" if x.affordances.quality[t] < choice.min_quality else ""


def key_frame_of(x: Extraction, t: int) -> tuple[int, int]:
    """Return (key frame, distance in frames) of the active mask of row t that is farthest from its key frame; (-1, 0) if unknown.
    """
    entities = [entity.entity_id for entity in x.tracks.entities]
    used = [entities.index(name) for name in _active_entities(x, t) if name in entities]
    known = [n for n in used if x.tracks.distance[n, t] >= 0]
    if not known:
        return -1, 0
    farthest = max(known, key=lambda n: int(x.tracks.distance[n, t]))
    return int(x.tracks.source_frame[farthest, t]), int(x.tracks.distance[farthest, t])


def _active_entities(x: Extraction, t: int) -> Iterator[str]:
    for side, hand in enumerate(SIDES):
        touched = int(x.affordances.object_index[side, t])
        if touched >= 0:
            yield f"{hand} hand"
            yield x.affordances.objects[touched].entity_id


def samples(x: Extraction, rows: list[int], paths: MotionPaths, jpeg_quality: int) -> Iterator[Sample]:
    """Yield the samples of the selected rows, one per narration of the frame."""
    for t in rows:
        narrations = _narrations(x.labels, int(x.frames.frame[t]))
        for narration in narrations:
            yield _sample(x, t, narration, len(narrations) > 1, paths, jpeg_quality)


def _narrations(labels: FrameLabels, frame: int) -> list[Narration]:
    start, stop = np.searchsorted(labels.frame, [frame, frame + 1])
    return [labels.narrations[n] for n in labels.narration[start:stop].tolist()]


def _sample(x: Extraction, t: int, narration: Narration, several: bool, paths: MotionPaths, jpeg_quality: int) -> Sample:
    frame = int(x.frames.frame[t])
    names, masks = _objects(x, t)
    key_frame, key_distance = key_frame_of(x, t)
    return Sample(
        sample_id=f"{x.clip.video_id}_{frame:010d}" + (f"_{narration.narration_id}" if several else ""),
        frame=frame,
        time_ns=int(x.frames.time_ns[t]),
        image_jpeg=encode_jpeg(x.inpainted.rgb[t], jpeg_quality),
        masks=np.concatenate([x.affordances.masks[:, t], masks]),
        object_left=names[0],
        object_right=names[1],
        narration=narration,
        taxonomy=int(x.affordances.taxonomy[t]),
        quality=float(x.affordances.quality[t]),
        inpaint_confidence=_confidence(x.inpainted, t),
        key_frame=key_frame,
        key_distance=key_distance,
        motion=paths.after(t, [_entity_id(x, side, t) for side in range(2)]),
        motion_time_ns=paths.steps_ns,
    )


def _entity_id(x: Extraction, side: int, t: int) -> str:
    touched = int(x.affordances.object_index[side, t])
    return x.affordances.objects[touched].entity_id if touched >= 0 else ""


def _objects(x: Extraction, t: int) -> tuple[list[str], np.ndarray]:
    """Return the names ('' for none) and complete masks (2, h, w) of the objects held by the left and the right hand."""
    names, masks = ["", ""], np.zeros((2, *x.frames.rgb.shape[1:3]), bool)
    complete = {entity.entity_id: n for n, entity in enumerate(x.complete.entities)}
    for side in range(2):
        touched = int(x.affordances.object_index[side, t])
        if touched >= 0:
            entity = x.affordances.objects[touched]
            names[side] = entity.name
            masks[side] = x.complete.masks[complete[entity.entity_id], t]
    return names, masks


def _confidence(inpainted: Inpainted, t: int) -> float:
    replaced = inpainted.confidence[t][inpainted.mask[t]]
    return float(replaced.mean()) / 255.0 if replaced.size else 1.0


def as_samples(x: Extraction, made: list[Sample], reasons: Counter[str]) -> Samples:
    """Collect the samples of a clip in a Samples value."""
    height, width = x.frames.rgb.shape[1:3]
    return Samples(x.clip.clip_id, x.clip.video_id, x.clip.participant_id, x.clip.split, width, height,
                   tuple(made), tuple(sorted(reasons.items())))
