"""Tasks that are told what the chain of affordances predicts instead of the truth, which stays for judging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.spatial import cKDTree

from schemas.grasp import GraspObject, GraspTask
from schemas.mesh import ObjectMesh
from schemas.surface import NegativeAffordance, NegativeAffordances, PositiveAffordance, PositiveAffordances

SAME_M = 1e-4
"""extents of the mesh that was looked at and of the body that is grasped agree within it"""
MOST = 0.5
"""a part is told to be negative when more than this share of its points is"""
Said = TypeVar("Said", NegativeAffordance, PositiveAffordance)


def same(body: GraspObject, mesh: ObjectMesh) -> None:
    """ValueError unless a body is of this mesh, in its frame and size."""
    size = np.ptp(mesh.vertices, axis=0)
    if body.name != mesh.name or not np.allclose(body.size_m, size, atol=SAME_M):
        raise ValueError(f"grasp tasks: expected tasks of what was looked at, {mesh.name} of {_mm(size)} mm, got "
                         f"{body.name} of {_mm(body.size_m)} mm; give the body's own mesh, scales=1")  # fmt: skip


def told_negative(task: GraspTask, found: NegativeAffordances) -> GraspTask:
    """The task with N_t as it is predicted for its use. ValueError where the use was not asked about."""
    said = for_use(task, found.tasks)
    nearest = cKDTree(found.points).query(task.body.points)[1]
    parts = [name for k, name in enumerate(task.body.parts) if _mostly(said.negative[nearest], task.body.point_part == k)]
    return replace(task, N_t=said.N_t.astype(np.float64), told=tuple(parts))


def told_positive(task: GraspTask, found: PositiveAffordances) -> GraspTask:
    """The task with A_t as it is predicted for its use. ValueError where the use was not asked about."""
    return replace(task, A_t=for_use(task, found.tasks).A_t.astype(np.float64))


def for_use(task: GraspTask, said: Sequence[Said]) -> Said:
    """What is said of the task's use."""
    known = {one.task: one for one in said}
    if task.use not in known:
        raise ValueError(f"{task.name}: expected a prediction for the use {task.use!r}, got those for {', '.join(known) or 'none'}"
                         "; let part_describe.tasks name it, or be empty for all uses of the lexicon")  # fmt: skip
    return known[task.use]


def _mostly(negative: np.ndarray, on_part: np.ndarray) -> bool:
    return bool(on_part.any() and negative[on_part].mean() > MOST)


def _mm(size_m: np.ndarray) -> str:
    return " x ".join(f"{1000 * side:.1f}" for side in size_m)
