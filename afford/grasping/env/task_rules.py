"""Rules that turn the lexicon of uses into grasp tasks, and that replace the truth of a task by predicted affordances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from afford.grasping.env.measures import SAFE_M, nearest
from afford.grasping.env.task import NEGATIVE_POINTS, make_task, spread_points
from afford.surface.describe.lexicon import TASKS, look_up
from schemas.grasp import GraspObject, GraspTask
from schemas.mesh import ObjectMesh
from schemas.surface import NegativeAffordance, NegativeAffordances, PositiveAffordance, PositiveAffordances


def tasks_of(body: GraspObject, category: str, level: str, label: str, least_m: float, thickness_m: tuple[float, float],
             within_m: float, ballast: float = 1.0) -> Iterator[GraspTask]:  # fmt: skip
    """Yield a task for each set of negative parts; uses with the same negative parts are one task.

    Negative parts are `ballast` times as dense as the others, which changes no use. ValueError for an unknown category.
    """
    if category not in TASKS:
        raise ValueError(f"{body.name}: expected a category of the lexicon, got {category!r}; known are {', '.join(sorted(TASKS))}")
    done = set[tuple[str, ...]]()
    for use in TASKS[category]:
        notes = look_up(body.name, category, use).notes
        negative = tuple(note.part for note in notes if note.role == "negative" and note.part in body.parts)
        hold = next((part for part in _largest_first(body) if part in {n.part for n in notes if n.role == "positive"}), "")
        if not negative or not hold or negative in done:
            continue
        made = make_task(body, negative, hold)
        if not holdable(body, hold, made.N_t, least_m, thickness_m) or negative_distance(body, made.N_t) > within_m:
            continue
        done.add(negative)
        name = "/".join(filter(None, (body.name + label, use.replace(" ", "_"))))
        A_t = spread_points(safe_points(body, hold, made.N_t), NEGATIVE_POINTS)
        yield GraspTask(name, level, use, with_ballast(body, negative, ballast), negative, hold, made.N_t, negative, A_t)


def holdable(body: GraspObject, part: str, N_t: np.ndarray, least_m: float, thickness_m: tuple[float, float]) -> bool:
    """Test whether a hand can hold the safe points of a part, those 2 cm from N_t (k, 3).

    They must be long enough, and neither too thin nor too thick. Extents are between the 2nd and the 98th percentile along their
    axes.
    """
    spots = safe_points(body, part, N_t)
    if len(spots) < 8:
        return False
    axes = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2]
    length, across, thin = np.ptp(np.percentile((spots - spots.mean(0)) @ axes.T, [2, 98], axis=0), axis=0)
    return bool(length >= least_m and thickness_m[0] <= thin and across <= thickness_m[1])


def safe_points(body: GraspObject, part: str, N_t: np.ndarray) -> np.ndarray:
    """(m, 3) float64 points of a part that are farther than 2 cm from N_t (k, 3)."""
    spots = body.points[body.point_part == body.parts.index(part)].astype(np.float64)
    return spots[nearest(spots[None], N_t[None])[0][0] > SAFE_M] if len(N_t) else spots


def negative_distance(body: GraspObject, N_t: np.ndarray) -> float:
    """Distance (m) along the lying object from its centre of mass to the nearest negative point (k, 3)."""
    spots = body.points[:, :2].astype(np.float64)
    axis = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2][0]
    return float(np.abs((N_t - body.com_m)[:, :2] @ axis).min())


def scaled(body: GraspObject, factor: float) -> GraspObject:
    """Scale an object at the same density."""
    lengths = {name: getattr(body, name) * factor for name in ("corners", "com_m", "size_m", "stand_out_m")}
    points = (body.points * np.float32(factor)).astype(np.float32)
    return replace(body, points=points, mass_kg=body.mass_kg * factor**3, inertia_kgm2=body.inertia_kgm2 * factor**5, **lengths)


def with_ballast(body: GraspObject, parts: Sequence[str], times: float) -> GraspObject:
    """Make some parts of an object `times` as dense as the others, whose mass stays the same.

    The mass of the object is divided among its parts by the volumes of their hulls.
    """
    if times == 1.0:
        return body
    hulls = [trimesh.convex.convex_hull(corners) for corners in body.hulls()]
    density = body.mass_kg / sum(hull.volume for hull in hulls) * (times - 1)
    added = [hull for hull, part in zip(hulls, body.hull_part, strict=True) if body.parts[part] in parts]
    masses = np.array([body.mass_kg, *(density * hull.volume for hull in added)])
    centres = np.array([body.com_m, *(hull.center_mass for hull in added)])
    inertias = [body.inertia_kgm2, *(density * hull.moment_inertia for hull in added)]
    com = masses @ centres / masses.sum()
    offset = centres - com
    steiner = [m * (d @ d * np.eye(3) - np.outer(d, d)) for m, d in zip(masses, offset, strict=True)]
    return replace(body, mass_kg=float(masses.sum()), com_m=com, inertia_kgm2=np.sum([*inertias, *steiner], axis=0))


def _largest_first(body: GraspObject) -> list[str]:
    count = np.bincount(body.point_part[body.point_part >= 0], minlength=len(body.parts))
    return [body.parts[k] for k in np.argsort(-count, kind="stable")]


SAME_M = 1e-4
"""extents of the mesh of a prediction and of the body to grasp agree within this"""
MOST = 0.5
"""a part is negative by a prediction when more than this share of its points is"""
Prediction = TypeVar("Prediction", NegativeAffordance, PositiveAffordance)


def check_same_object(body: GraspObject, mesh: ObjectMesh) -> None:
    """Raise ValueError unless a body is that of a mesh, in its frame and size."""
    size = np.ptp(mesh.vertices, axis=0)
    if body.name != mesh.name or not np.allclose(body.size_m, size, atol=SAME_M):
        raise ValueError(f"grasp tasks: expected tasks of the object that was predicted, {mesh.name} of {_mm(size)} mm, got "
                         f"{body.name} of {_mm(body.size_m)} mm; give the body's own mesh, scales=1")  # fmt: skip


def with_predicted_negative(task: GraspTask, found: NegativeAffordances) -> GraspTask:
    """Replace N_t of a task by the prediction for its use. ValueError without a prediction for the use."""
    prediction = prediction_for(task, found.tasks)
    closest = cKDTree(found.points).query(task.body.points)[1]
    parts = [name for k, name in enumerate(task.body.parts) if _mostly(prediction.negative[closest], task.body.point_part == k)]
    return replace(task, N_t=prediction.N_t.astype(np.float64), told=tuple(parts))


def with_predicted_positive(task: GraspTask, found: PositiveAffordances) -> GraspTask:
    """Replace A_t of a task by the prediction for its use. ValueError without a prediction for the use."""
    return replace(task, A_t=prediction_for(task, found.tasks).A_t.astype(np.float64))


def prediction_for(task: GraspTask, predictions: Sequence[Prediction]) -> Prediction:
    """Prediction for the use of a task."""
    known = {one.task: one for one in predictions}
    if task.use not in known:
        raise ValueError(f"{task.name}: expected a prediction for the use {task.use!r}, got those for {', '.join(known) or 'none'}"
                         "; let part_describe.tasks name it, or be empty for all uses of the lexicon")  # fmt: skip
    return known[task.use]


def _mostly(negative: np.ndarray, on_part: np.ndarray) -> bool:
    return bool(on_part.any() and negative[on_part].mean() > MOST)


def _mm(size_m: np.ndarray) -> str:
    return " x ".join(f"{1000 * side:.1f}" for side in size_m)
