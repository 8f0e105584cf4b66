"""One clip's outputs, frame by frame -> its samples: which frames count, and what a sample carries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from afford.common.image_files import encode_jpeg
from afford.dataset.motion import Paths
from schemas.affordance import Affordances, FrameLabels, Rejection, Sample, Samples
from schemas.masks import CompleteObjects, Tracks
from schemas.video import SIDES, Clip, Frames, Inpainted, Narration


@dataclass(frozen=True)
class Extraction:
    """Everything that the extraction stages made of one clip; row t means the same frame in all of it."""

    clip: Clip
    frames: Frames
    inpainted: Inpainted
    tracks: Tracks
    complete: CompleteObjects
    affordances: Affordances
    labels: FrameLabels

    def check(self) -> None:
        """ValueError when two parts speak of different frames, or an object that is held has no complete mask."""
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
class Choice:
    """Which accepted frames become samples; 0 switches a limit off."""

    stride_frames: int
    max_key_distance: int
    min_quality: float


def choose(x: Extraction, choice: Choice) -> tuple[list[int], Counter[str]]:
    """Rows t that give samples, and for every other frame the first reason why it does not."""
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


def _reason(x: Extraction, choice: Choice, t: int, labelled: bool) -> str:
    rejection = Rejection(int(x.affordances.rejection[t]))
    if rejection is not Rejection.ACCEPTED:
        return rejection.name.lower()
    if not labelled:
        return "no_narration"
    if choice.max_key_distance and key_of(x, t)[1] > choice.max_key_distance:
        return "far_from_key_frame"
    return "below_min_quality" if x.affordances.quality[t] < choice.min_quality else ""


def key_of(x: Extraction, t: int) -> tuple[int, int]:
    """(key frame, distance in frames) of the mask of row t that is farthest from its key frame; (-1, 0) when unknown."""
    entities = [entity.entity_id for entity in x.tracks.entities]
    used = [entities.index(name) for name in _used(x, t) if name in entities]
    known = [n for n in used if x.tracks.distance[n, t] >= 0]
    if not known:
        return -1, 0
    farthest = max(known, key=lambda n: int(x.tracks.distance[n, t]))
    return int(x.tracks.source_frame[farthest, t]), int(x.tracks.distance[farthest, t])


def _used(x: Extraction, t: int) -> Iterator[str]:
    for side, hand in enumerate(SIDES):
        touched = int(x.affordances.object_index[side, t])
        if touched >= 0:
            yield f"{hand} hand"
            yield x.affordances.objects[touched].entity_id


def samples(x: Extraction, rows: list[int], paths: Paths, jpeg_quality: int) -> Iterator[Sample]:
    """The samples of the chosen rows: one per narration of the frame (one, but for the policy `all`)."""
    for t in rows:
        narrations = _narrations(x.labels, int(x.frames.frame[t]))
        for narration in narrations:
            yield _sample(x, t, narration, len(narrations) > 1, paths, jpeg_quality)


def _narrations(labels: FrameLabels, frame: int) -> list[Narration]:
    start, stop = np.searchsorted(labels.frame, [frame, frame + 1])
    return [labels.narrations[n] for n in labels.narration[start:stop].tolist()]


def _sample(x: Extraction, t: int, narration: Narration, several: bool, paths: Paths, jpeg_quality: int) -> Sample:
    frame = int(x.frames.frame[t])
    names, masks = _objects(x, t)
    key_frame, key_distance = key_of(x, t)
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
    """Names ('' for none) and complete masks (2, h, w) of what the left and the right hand hold."""
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


def bundle(x: Extraction, made: list[Sample], reasons: Counter[str]) -> Samples:
    """The samples of a clip as one value."""
    height, width = x.frames.rgb.shape[1:3]
    return Samples(x.clip.clip_id, x.clip.video_id, x.clip.participant_id, x.clip.split, width, height,
                   tuple(made), tuple(sorted(reasons.items())))
