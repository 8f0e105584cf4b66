"""Annotations that are the same thing in different key frames become one entity.

VISOR gives every mask of every frame its own id. Hands are the same by side, objects by name. Where one image shows a name
twice, its instances are followed by overlap: masks are carried to the next key frame and matched to the annotations there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.common.masks import iou
from afford.extraction.tracks.keys import Key
from schemas.masks import Entity
from schemas.video import SIDES, Annotation

Carry = Callable[[Key, Key, np.ndarray], np.ndarray]
"""(key, next key, masks (m, h, w) bool in the first) -> the same masks (m, h, w) bool in the second"""


@dataclass(frozen=True)
class Links:
    """Entities of a clip, and which of them each annotation of each key frame is (-1: none, e.g. one mask for both hands)."""

    entities: tuple[Entity, ...]
    of: list[list[int]]


def link(keys: list[Key], carry: Carry, min_iou: float) -> Links:
    """Find the entities. An instance of a repeated name that overlaps no carried mask by `min_iou` is a new entity."""
    repeated = {name for key in keys for name, n in Counter(_objects(key)).items() if n > 1}
    instance = [[0] * len(key.annotations) for key in keys]
    for name in sorted(repeated):
        for row, numbers in zip(instance, _follow(name, keys, carry, min_iou), strict=True):
            for i, number in numbers.items():
                row[i] = number
    found = [
        [_entity(a, number) for a, number in zip(key.annotations, row, strict=True)]
        for key, row in zip(keys, instance, strict=True)
    ]
    entities = _order({e.entity_id: e for row in reversed(found) for e in row if e})
    index = {entity.entity_id: i for i, entity in enumerate(entities)}
    return Links(entities, [[index[e.entity_id] if e else -1 for e in row] for row in found])


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
    """Hands first (left, right), then objects by id."""
    return tuple(sorted(entities.values(), key=lambda e: (e.role != "hand", e.entity_id)))


def _follow(name: str, keys: list[Key], carry: Carry, min_iou: float) -> list[dict[int, int]]:
    """Per key frame: index of each annotation called `name` -> number of its instance, 1-based in order of appearance."""
    found: list[dict[int, int]] = []
    count = 0
    for k, key in enumerate(keys):
        here = [i for i, a in enumerate(key.annotations) if a.name == name and a.side == ""]
        numbers = _continue(keys[k - 1], key, found[-1], here, carry, min_iou) if k else {}
        for i in here:
            if i not in numbers:
                count += 1
                numbers[i] = count
        found.append(numbers)
    return found


def _continue(last: Key, key: Key, known: dict[int, int], here: list[int], carry: Carry, min_iou: float) -> dict[int, int]:
    """Instance numbers of the annotations `here` that continue one of the last key frame's."""
    if not known or not here:
        return {}
    carried = carry(last, key, last.masks[list(known)])
    overlap = np.array([[iou(mask, key.masks[i]) for i in here] for mask in carried])
    numbers = list(known.values())
    return {here[j]: numbers[m] for m, j in zip(*linear_sum_assignment(-overlap), strict=True) if overlap[m, j] >= min_iou}
