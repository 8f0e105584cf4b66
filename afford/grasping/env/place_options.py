"""Places of one use of a body, as different as possible: on each part that may be held, on its pieces, in each stable pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.body_parts import parted_by_pieces
from afford.grasping.env.families import LEAST
from afford.grasping.env.rest_choice import Turns, laid, places_of, steady_turns
from afford.grasping.env.task import NEGATIVE_POINTS, spread_points
from afford.grasping.env.task_rules import safe_points
from schemas.grasp import GraspObject, GraspTask

STEP_RAD = 0.1
"""poses in which a body is tilted by less are one: a curved side rests on many faces of its hull"""
TILT_RAD, APART_M, PARALLEL = 0.35, 0.02, 0.9
"""places in poses that are tilted by less, nearer than this, with axes more parallel than this cosine, are one"""
LEAST_FIT = 0.02
"""places of less fit are none"""


@dataclass(frozen=True, eq=False)
class PlaceOption:
    """A use with its body laid for one place, the best of its pose; vectors are in the frame of the body as it was given."""

    task: GraspTask
    family: str
    up: np.ndarray
    """(3,) unit axis that is vertical"""
    at_m: np.ndarray
    """(3,) middle of what is gripped, from the mean of the points"""
    along: np.ndarray
    """(3,) unit axis across which the fingers close"""
    fit: float
    """times the steadiness of the pose"""


def place_options(task: GraspTask, parts: Sequence[str], most: int, turned: bool = True) -> list[GraspTask]:
    """Return the task as it is, then itself at other places of `parts`, best first; `most` in all.

    A place on a piece of a part is on a part of its own, which is named after both. The body is laid in any stable pose, or stays
    in its own unless it may be `turned`. ValueError for a task without a place.
    """
    first = _option(task, Rotation.identity(), 1.0)
    if first is None:
        raise ValueError(f"{task.name}: expected a part that a hand can hold, got none")
    found = [first]
    for one in sorted(_other_places(task, parts, turned), key=lambda one: -one.fit):
        if len(found) < most and not any(_same(one, known) for known in found):
            found.append(one)
    return [task, *(_with_positive(one.task) for one in found[1:])]


def distinct_turns(turns: Turns) -> Turns:
    """Keep the first of the rotations that lay a body on nearly the same side."""
    kept: Turns = []
    for turn, steady in turns:
        up = turn.as_matrix()[2]
        if all(up @ other.as_matrix()[2] < np.cos(STEP_RAD) for other, _ in kept):
            kept.append((turn, steady))
    return kept


def _other_places(task: GraspTask, parts: Sequence[str], turned: bool) -> Iterator[PlaceOption]:
    task = _own_arrays(task)
    wanted = [one for part in parts for one in (replace(task, hold=part), *_on_pieces(task, part))]
    for turn, steady in distinct_turns(steady_turns(task.body)) if turned else [(Rotation.identity(), 1.0)]:
        made = (_option(laid(one, turn), turn, steady) for one in wanted)
        yield from (one for one in made if one is not None and one.fit >= LEAST_FIT * steady)


def _option(task: GraspTask, turn: Rotation, steady: float) -> PlaceOption | None:
    places = places_of(task)
    if not places:
        return None
    back, place = turn.inv(), places[0]
    at = back.apply(place.at_m - task.body.points.mean(0, dtype=np.float64))
    return PlaceOption(task, place.family, turn.as_matrix()[2], at, back.apply(place.along), place.fit * steady)


def _same(one: PlaceOption, other: PlaceOption) -> bool:
    near = float(np.linalg.norm(one.at_m - other.at_m)) < APART_M
    return bool(one.family == other.family and near and one.up @ other.up > np.cos(TILT_RAD)
                and abs(one.along @ other.along) > PARALLEL)  # fmt: skip


def _own_arrays(task: GraspTask) -> GraspTask:
    """Copy what rotations are applied to: they refuse the read-only arrays of a file."""
    one = task.body
    body = replace(one, corners=np.array(one.corners), com_m=np.array(one.com_m), points=np.array(one.points),
                   normals=np.array(one.normals))  # fmt: skip
    return replace(task, body=body, N_t=np.array(task.N_t), A_t=np.array(task.A_t))


def _with_positive(task: GraspTask) -> GraspTask:
    return replace(task, A_t=spread_points(safe_points(task.body, task.hold, task.N_t), NEGATIVE_POINTS))


def _on_pieces(task: GraspTask, part: str) -> Iterator[GraspTask]:
    """Yield the task on each convex piece of a part that has several of them."""
    body, index = task.body, task.body.parts.index(part)
    piece = parted_by_pieces(body).point_part
    pieces = np.flatnonzero(np.bincount(piece[body.point_part == index], minlength=len(body.hull_part)) >= LEAST)
    for k in pieces if len(pieces) > 1 else ():
        yield replace(task, body=_with_piece(body, index, int(k), piece == k), hold=_piece_name(part, int(k)))


def _with_piece(body: GraspObject, index: int, hull: int, points: np.ndarray) -> GraspObject:
    """Body whose hull, and `points` (n,) bool deepest in it, are a part of their own where they belong to the part `index`."""
    new, hulls = len(body.parts), np.arange(len(body.hull_part)) == hull
    return replace(body, parts=(*body.parts, _piece_name(body.parts[index], hull)),
                   hull_part=np.where(hulls & (body.hull_part == index), new, body.hull_part).astype(np.int16),
                   point_part=np.where(points & (body.point_part == index), new, body.point_part).astype(np.int16))  # fmt: skip


def _piece_name(part: str, hull: int) -> str:
    return f"{part}, piece {hull}"
