"""From where to look: the six cardinal views, and more of them until what can be seen from outside has been seen well.

Greedy next best views. Candidates stand all around the object and, for places that none of those sees well (the bottom of a mug, a
slot), on the very rays along which such a place can be seen.
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
"""candidates for places that are hard to see, in each round"""
LEAST_GAIN = 5e-4
"""a view that adds less than this share of the area is not worth its time"""


@dataclass(frozen=True)
class ViewSettings:
    """What is asked of the views."""

    distance: float = 4.0
    """of the cameras from the middle, in radii of the object"""
    good_deg: float = 70.0
    """largest angle between the line of sight and the normal at which a place is seen well"""
    share: float = 0.99
    """of the visible area that is to be seen well; 0 for the six views alone"""
    most: int = 32
    """views at most"""


@dataclass(frozen=True, eq=False)
class ViewPlan:
    """(n, 3) directions of the cameras from the middle, `share` (n,) of the visible area seen well by the first 1..n of them, and
    `visible` (p,) bool of the surface's points.
    """

    towards: np.ndarray
    share: np.ndarray
    visible: np.ndarray


def plan_views(surface: Surface, rays: Rays, around: Sphere, wish: ViewSettings, directions: np.ndarray) -> ViewPlan:
    """The six views and those added; `directions` (d, 3) are tried to find out what can be seen from outside at all."""
    visible = surface.visible(rays, directions)
    weight = np.where(visible, surface.area, 0.0) / max(float(surface.area[visible].sum()), 1e-30)
    eyes = around.eye(np.array(list(CARDINAL.values()), float), wish.distance)
    seen = well_seen(surface, rays, eyes, wish.good_deg)
    covered, shares = _cover(seen, weight)
    while shares[-1] < wish.share and len(eyes) < wish.most:
        added, gains = _next(surface, rays, around, wish, weight * ~covered, directions, round_=len(eyes))
        if gains < LEAST_GAIN:
            break
        eyes = np.concatenate([eyes, added[None]])
        covered |= well_seen(surface, rays, added[None], wish.good_deg)[0]
        shares = np.append(shares, weight[covered].sum())
    return ViewPlan(eyes - around.centre, shares, visible)


def well_seen(surface: Surface, rays: Rays, eyes: np.ndarray, good_deg: float) -> np.ndarray:
    """(e, n) bool: which points each eye (e, 3) sees, nothing between, within `good_deg` of their normals."""
    out = np.zeros((len(eyes), len(surface.points)), bool)
    for row, eye in zip(out, eyes.astype(np.float32), strict=True):
        line = eye - surface.points
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        asked = np.flatnonzero((line * surface.normals).sum(1) >= np.cos(np.radians(good_deg)))
        row[asked] = rays.escape(surface.points[asked], surface.normals[asked], line[asked])
    return out


def _cover(seen: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What all eyes saw (n,), and the share seen by the first 1..e of them."""
    so_far = np.logical_or.accumulate(seen, axis=0)
    return so_far[-1], so_far @ weight


def _next(surface: Surface, rays: Rays, around: Sphere, wish: ViewSettings, missing: np.ndarray, directions: np.ndarray,
          round_: int) -> tuple[np.ndarray, float]:  # fmt: skip
    """The eye (3,) that sees most of what is missing (n,) area, and how much."""
    left = np.flatnonzero(missing)
    rest = Surface(surface.points[left], surface.normals[left], surface.face[left], surface.area[left])
    spread = around.eye(fibonacci_sphere(AROUND), wish.distance)
    eyes = np.concatenate([spread, _on_rays(rest, rays, around, wish, directions, round_)])
    gains = well_seen(rest, rays, eyes, wish.good_deg) @ missing[left]
    best = int(gains.argmax())
    return eyes[best], float(gains[best])


def _on_rays(rest: Surface, rays: Rays, around: Sphere, wish: ViewSettings, directions: np.ndarray, round_: int) -> np.ndarray:
    """Eyes from which some of the points that are left are seen most squarely: where their freest rays meet the cameras' sphere."""
    some = np.random.default_rng(round_).choice(len(rest.points), min(RAYS, len(rest.points)), replace=False)
    points, normals = rest.points[some], rest.normals[some]
    square = normals @ directions.T.astype(np.float32)
    free = np.stack([rays.escape(points, normals, np.broadcast_to(d, points.shape)) for d in directions.astype(np.float32)], axis=1)
    square = np.where(free, square, -1)
    best = square.argmax(1)
    start, way = points[square.max(1) > 0] - around.centre, directions[best[square.max(1) > 0]]
    along = (start * way).sum(1)
    far = np.sqrt(along**2 - (start * start).sum(1) + (wish.distance * around.radius_m) ** 2) - along
    return np.asarray(around.centre + start + far[:, None] * way)


SIX = 6


def cardinal_views(views: ObjectViews) -> ObjectViews:
    """The first six views of an object, arrays shared with the given ones."""
    return replace(views, views=views.views[:SIX], rgb=views.rgb[:SIX], face=views.face[:SIX], depth_m=views.depth_m[:SIX],
                   K=views.K[:SIX], T_obj_cam=views.T_obj_cam[:SIX], seen_area=views.seen_area[:SIX])  # fmt: skip
