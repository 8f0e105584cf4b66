"""Plan views of an object: the six cardinal ones, and greedy next best views until the surface is covered.

Candidate cameras are all around the object. For surface points that none of them sees well (the bottom of a mug, a slot),
candidates are placed on the rays along which such a point is visible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.render.camera import CARDINAL, Sphere
from afford.render.views.surface import Rays, Surface, fibonacci_sphere
from schemas.mesh import ObjectViews

AROUND = 128
"""candidates all around"""
RAYS = 192
"""candidates on rays of hidden points, in each round"""
LEAST_GAIN = 5e-4
"""smallest share of the area that a view must add"""


@dataclass(frozen=True)
class ViewSettings:
    """Settings of view planning."""

    distance: float = 4.0
    """distance of the cameras from the centre, in radii of the object"""
    good_deg: float = 70.0
    """largest angle between line of sight and normal of a well seen point"""
    share: float = 0.99
    """share of the visible area that must be well seen; 0 for the six views alone"""
    most: int = 32
    """largest number of views"""


@dataclass(frozen=True, eq=False)
class ViewPlan:
    """Planned camera directions and their coverage.

    `towards` (n, 3) are directions from the centre, `share` (n,) is the part of the visible area that the first 1..n views see
    well, and `visible` (p,) bool marks visible surface points.
    """

    towards: np.ndarray
    share: np.ndarray
    visible: np.ndarray


def plan_views(surface: Surface, rays: Rays, around: Sphere, settings: ViewSettings, directions: np.ndarray) -> ViewPlan:
    """Plan the six cardinal views and the added ones.

    Rays in `directions` (d, 3) decide which surface points are visible from outside at all.
    """
    visible = surface.visible(rays, directions)
    weight = np.where(visible, surface.area, 0.0) / max(float(surface.area[visible].sum()), 1e-30)
    eyes = around.eye(np.array(list(CARDINAL.values()), float), settings.distance)
    seen = well_seen(surface, rays, eyes, settings.good_deg)
    covered, shares = _cover(seen, weight)
    while shares[-1] < settings.share and len(eyes) < settings.most:
        added, gains = _next(surface, rays, around, settings, weight * ~covered, directions, round_=len(eyes))
        if gains < LEAST_GAIN:
            break
        eyes = np.concatenate([eyes, added[None]])
        covered |= well_seen(surface, rays, added[None], settings.good_deg)[0]
        shares = np.append(shares, weight[covered].sum())
    return ViewPlan(eyes - around.centre, shares, visible)


def well_seen(surface: Surface, rays: Rays, eyes: np.ndarray, good_deg: float) -> np.ndarray:
    """Find points that each eye (e, 3) sees without occlusion, within `good_deg` of the normals: (e, n) bool."""
    out = np.zeros((len(eyes), len(surface.points)), bool)
    for row, eye in zip(out, eyes.astype(np.float32), strict=True):
        line = eye - surface.points
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        facing = np.flatnonzero((line * surface.normals).sum(1) >= np.cos(np.radians(good_deg)))
        row[facing] = rays.escape(surface.points[facing], surface.normals[facing], line[facing])
    return out


def _cover(seen: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n,) that all eyes saw, and the share seen by the first 1..e eyes."""
    so_far = np.logical_or.accumulate(seen, axis=0)
    return so_far[-1], so_far @ weight


def _next(surface: Surface, rays: Rays, around: Sphere, settings: ViewSettings, missing: np.ndarray, directions: np.ndarray,
          round_: int) -> tuple[np.ndarray, float]:  # fmt: skip
    """Return the eye (3,) that sees most of the `missing` (n,) area, and that area."""
    left = np.flatnonzero(missing)
    rest = Surface(surface.points[left], surface.normals[left], surface.face[left], surface.area[left])
    spread = around.eye(fibonacci_sphere(AROUND), settings.distance)
    eyes = np.concatenate([spread, _on_rays(rest, rays, around, settings, directions, round_)])
    gains = well_seen(rest, rays, eyes, settings.good_deg) @ missing[left]
    best = int(gains.argmax())
    return eyes[best], float(gains[best])


def _on_rays(rest: Surface, rays: Rays, around: Sphere, settings: ViewSettings, directions: np.ndarray, round_: int) -> np.ndarray:
    """Place eyes on the free rays of some hidden points, as perpendicular to the surface as possible."""
    some = np.random.default_rng(round_).choice(len(rest.points), min(RAYS, len(rest.points)), replace=False)
    points, normals = rest.points[some], rest.normals[some]
    square = normals @ directions.T.astype(np.float32)
    free = np.stack([rays.escape(points, normals, np.broadcast_to(d, points.shape)) for d in directions.astype(np.float32)], axis=1)
    square = np.where(free, square, -1)
    best = square.argmax(1)
    start, way = points[square.max(1) > 0] - around.centre, directions[best[square.max(1) > 0]]
    along = (start * way).sum(1)
    far = np.sqrt(along**2 - (start * start).sum(1) + (settings.distance * around.radius_m) ** 2) - along
    return np.asarray(around.centre + start + far[:, None] * way)


SIX = 6


def cardinal_views(views: ObjectViews) -> ObjectViews:
    """Return the first six views of an object; arrays are shared with the input."""
    return replace(views, views=views.views[:SIX], rgb=views.rgb[:SIX], face=views.face[:SIX], depth_m=views.depth_m[:SIX],
                   K=views.K[:SIX], T_obj_cam=views.T_obj_cam[:SIX], seen_area=views.seen_area[:SIX])  # fmt: skip
