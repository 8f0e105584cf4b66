"""Key frames of a clip at working size: every annotation as a mask, at its position among the frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.common.masks import iou
from afford.extraction.sources.outlines import rasterise
from schemas.masks import Entity, TrackFlag
from schemas.video import SIDES, Annotation, Clip, Frames


@dataclass(frozen=True)
class Key:
    """An annotated frame, its annotations as masks at working size."""

    at: int
    """position in `Frames.frame`"""
    annotations: tuple[Annotation, ...]
    masks: np.ndarray
    """(a, h, w) bool, one for each annotation"""


def read_keys(clip: Clip, frames: Frames, dense: bool) -> list[Key]:
    """Read the decoded key frames of a clip in order; `dense` includes dense annotations. ValueError when no key frame is left."""
    height_px, width_px = frames.rgb.shape[1:3]
    position = {int(number): i for i, number in enumerate(frames.frame)}
    keys = []
    for key in clip.key_frames:
        if key.frame not in position or (key.dense and not dense):
            continue
        masks = [rasterise(a, key.width_px, key.height_px, width_px, height_px) for a in key.annotations]
        stack = np.stack(masks) if masks else np.zeros((0, height_px, width_px), bool)
        keys.append(Key(position[key.frame], key.annotations, stack))
    if not keys:
        kind = "key frame" if dense else "sparse key frame"
        raise ValueError(f"clip {clip.clip_id}: no {kind} among its {len(frames.frame)} decoded frames; annotate one of them")
    return keys


def runs(frame: np.ndarray, max_step: int) -> list[slice]:
    """Split frame numbers (t,) into runs whose neighbours are at most `max_step` apart; motion is never chained across a gap."""
    cuts = [0, *(np.flatnonzero(np.diff(frame) > max_step) + 1).tolist(), len(frame)]
    return [slice(a, b) for a, b in pairwise(cuts)]


def evenly_spaced(time_s: np.ndarray, every_s: float) -> np.ndarray:
    """Choose positions in ascending times (n,) that are about `every_s` apart, including the first and the last."""
    count = max(round((time_s[-1] - time_s[0]) / every_s), 1) + 1
    wanted = np.linspace(time_s[0], time_s[-1], count)
    return np.unique(np.abs(time_s[:, None] - wanted).argmin(0))


PropagateMasks = Callable[[Key, Key, np.ndarray], np.ndarray]
"""function of (key, next key, masks (m, h, w) bool in the first) that returns the same masks (m, h, w) bool in the second"""


@dataclass(frozen=True)
class EntityLinks:
    """Entities of a clip, and the entity of each annotation."""

    entities: tuple[Entity, ...]
    of: list[list[int]]
    """entity of each annotation, by key frame; -1 without an entity, e.g. for one mask of both hands"""


def link_entities(keys: list[Key], propagate_masks: PropagateMasks, min_iou: float) -> EntityLinks:
    """Link the annotations of all key frames to entities.

    An instance of a repeated name that overlaps no propagated mask by `min_iou` is a new entity.
    """
    repeated = {name for key in keys for name, n in Counter(_objects(key)).items() if n > 1}
    instance = [[0] * len(key.annotations) for key in keys]
    for name in sorted(repeated):
        for row, numbers in zip(instance, _track_instances(name, keys, propagate_masks, min_iou), strict=True):
            for i, number in numbers.items():
                row[i] = number
    found = [
        [_entity(a, number) for a, number in zip(key.annotations, row, strict=True)]
        for key, row in zip(keys, instance, strict=True)
    ]
    entities = _order({e.entity_id: e for row in reversed(found) for e in row if e})
    index = {entity.entity_id: i for i, entity in enumerate(entities)}
    return EntityLinks(entities, [[index[e.entity_id] if e else -1 for e in row] for row in found])


def _objects(key: Key) -> list[str]:
    return [a.name for a in key.annotations if a.side == ""]


def _entity(annotation: Annotation, instance: int) -> Entity | None:
    if annotation.side in SIDES:
        return Entity(f"{annotation.side} hand", annotation.name, annotation.class_id, "hand", annotation.side)
    if annotation.side:
        return None
    entity_id = f"{annotation.name}#{instance}" if instance else annotation.name
    return Entity(entity_id, annotation.name, annotation.class_id, "object", "")


def _order(entities: dict[str, Entity]) -> tuple[Entity, ...]:
    """Sort entities: hands first (left, right), then objects by id."""
    return tuple(sorted(entities.values(), key=lambda e: (e.role != "hand", e.entity_id)))


def _track_instances(name: str, keys: list[Key], propagate_masks: PropagateMasks, min_iou: float) -> list[dict[int, int]]:
    """Number the instances of `name`: for each key frame, annotation index -> instance, 1-based in order of appearance."""
    found: list[dict[int, int]] = []
    count = 0
    for k, key in enumerate(keys):
        here = [i for i, a in enumerate(key.annotations) if a.name == name and a.side == ""]
        numbers = _match_instances(keys[k - 1], key, found[-1], here, propagate_masks, min_iou) if k else {}
        for i in here:
            if i not in numbers:
                count += 1
                numbers[i] = count
        found.append(numbers)
    return found


def _match_instances(
    last: Key, key: Key, known: dict[int, int], here: list[int], propagate_masks: PropagateMasks, min_iou: float
) -> dict[int, int]:
    """Match the annotations `here` to instances of the previous key frame by IoU; returns annotation index -> instance."""
    if not known or not here:
        return {}
    propagated = propagate_masks(last, key, last.masks[list(known)])
    overlap = np.array([[iou(mask, key.masks[i]) for i in here] for mask in propagated])
    numbers = list(known.values())
    return {here[j]: numbers[m] for m, j in zip(*linear_sum_assignment(-overlap), strict=True) if overlap[m, j] >= min_iou}


@dataclass(frozen=True)
class Bracket:
    """Bracketing key frames of each frame, as indices into the k key frames, -1 without one. A key frame brackets itself."""

    at: np.ndarray
    """(k,) positions of the key frames"""
    before: np.ndarray
    """(t,) int64"""
    after: np.ndarray
    """(t,) int64"""


def bracket(frame: np.ndarray, parts: list[slice], at: np.ndarray) -> Bracket:
    """Find the key frames, at positions `at` (k,), that bracket each of `frame` (t,); `parts` are the runs of the video."""
    before, after = np.full(len(frame), -1), np.full(len(frame), -1)
    for part in parts:
        position = np.arange(part.start, part.stop)
        left, right = np.searchsorted(at, position, "right") - 1, np.searchsorted(at, position, "left")
        before[part] = np.where((left >= 0) & (at[left] >= part.start), left, -1)
        inside = right < len(at)
        after[part] = np.where(inside & (at[np.minimum(right, len(at) - 1)] < part.stop), right, -1)
    return Bracket(at, before, after)


def nearest_source(frame: np.ndarray, around: Bracket, present: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest bracketing key frame that shows each entity, the earlier on a tie, and its distance in frames.

    present: (n, k) bool. Returns frame numbers and distances, both (n, t) int64, -1 where neither key frame shows the entity.
    """
    key_frame = frame[around.at]
    gaps = []
    for key in (around.before, around.after):
        shown = present[:, key] & (key >= 0)
        gaps.append(np.where(shown, np.abs(frame - key_frame[key]), np.iinfo(np.int64).max))
    nearer_before = gaps[0] <= gaps[1]
    distance = np.minimum(*gaps)
    source = np.where(nearer_before, key_frame[around.before], key_frame[around.after])
    none = distance == np.iinfo(np.int64).max
    return np.where(none, -1, source), np.where(none, -1, distance)


def track_flags(visible: np.ndarray, around: Bracket, present: np.ndarray) -> np.ndarray:
    """Compute TrackFlag bits (n, t) uint8. ENTERING and LEAVING mark every frame between the two key frames."""
    shown_before, shown_after = (present[:, key] & (key >= 0) for key in (around.before, around.after))
    both = (around.before >= 0) & (around.after >= 0)
    is_key = both & (around.before == around.after)
    bits = np.where(visible, TrackFlag.VISIBLE, 0)
    bits |= np.where(is_key & shown_before, TrackFlag.KEY, 0)
    bits |= np.where(both & ~shown_before & shown_after, TrackFlag.ENTERING, 0)
    bits |= np.where(both & shown_before & ~shown_after, TrackFlag.LEAVING, 0)
    return bits.astype(np.uint8)
