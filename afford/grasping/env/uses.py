"""What an object may be grasped for, by the lexicon, where a hand can hold it for that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import trimesh

from afford.grasping.env.measures import nearest
from afford.grasping.env.metrics import SAFE_M
from afford.grasping.env.task import NEGATIVE_POINTS, spread_points, task
from afford.surface.describe.lexicon import TASKS, look_up
from schemas.grasp import GraspObject, GraspTask


def uses(body: GraspObject, category: str, level: str, label: str, least_m: float, thickness_m: tuple[float, float],
         within_m: float, ballast: float = 1.0) -> Iterator[GraspTask]:  # fmt: skip
    """One for each set of forbidden parts: uses that forbid the same are one. Forbidden parts are `ballast` times as dense as the
    others, which changes no use. ValueError for an unknown category.
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
        made = task(body, negative, hold)
        if not holdable(body, hold, made.N_t, least_m, thickness_m) or aside(body, made.N_t) > within_m:
            continue
        done.add(negative)
        name = "/".join(filter(None, (body.name + label, use.replace(" ", "_"))))
        A_t = spread_points(safe(body, hold, made.N_t), NEGATIVE_POINTS)
        yield GraspTask(name, level, use, weighted(body, negative, ballast), negative, hold, made.N_t, negative, A_t)


def holdable(body: GraspObject, part: str, N_t: np.ndarray, least_m: float, thickness_m: tuple[float, float]) -> bool:
    """Whether what of a part is safe, 2 cm from N_t (k, 3), is long enough, and neither too thin nor too thick: its extents are
    between the 2nd and the 98th percentile along its axes.
    """
    spots = safe(body, part, N_t)
    if len(spots) < 8:
        return False
    axes = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2]
    length, across, thin = np.ptp(np.percentile((spots - spots.mean(0)) @ axes.T, [2, 98], axis=0), axis=0)
    return bool(length >= least_m and thickness_m[0] <= thin and across <= thickness_m[1])


def safe(body: GraspObject, part: str, N_t: np.ndarray) -> np.ndarray:
    """(m, 3) float64 points of a part that are farther than 2 cm from N_t (k, 3)."""
    spots = body.points[body.point_part == body.parts.index(part)].astype(np.float64)
    return spots[nearest(spots[None], N_t[None])[0][0] > SAFE_M] if len(N_t) else spots


def aside(body: GraspObject, N_t: np.ndarray) -> float:
    """How far (m) the nearest of the negative points (k, 3) is from the centre of mass, along the object as it lies."""
    spots = body.points[:, :2].astype(np.float64)
    axis = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2][0]
    return float(np.abs((N_t - body.com_m)[:, :2] @ axis).min())


def scaled(body: GraspObject, factor: float) -> GraspObject:
    """The same thing larger or smaller, of the same density."""
    lengths = {name: getattr(body, name) * factor for name in ("corners", "com_m", "size_m", "stand_out_m")}
    points = (body.points * np.float32(factor)).astype(np.float32)
    return replace(body, points=points, mass_kg=body.mass_kg * factor**3, inertia_kgm2=body.inertia_kgm2 * factor**5, **lengths)


def weighted(body: GraspObject, parts: Sequence[str], times: float) -> GraspObject:
    """The same thing with some of its parts `times` as dense as the others, whose mass stays; what a part weighs is divided as the
    volumes of the hulls are.
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
