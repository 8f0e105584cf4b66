"""From an object to its views: what can be seen, from where, and the pictures."""

from __future__ import annotations

import numpy as np

from afford.render.views.cameras import CARDINAL, Sphere
from afford.render.views.draw import Studio
from afford.render.views.plan import Wish, plan
from afford.render.views.rays import Rays
from afford.render.views.surface import Surface, sphere
from schemas.mesh import ObjectMesh, ObjectViews


def shoot(mesh: ObjectMesh, wish: Wish, directions: int, size_px: int, supersample: int) -> ObjectViews:
    """All views of one object; ValueError when it has no surface."""
    surface = Surface.of(mesh)
    if not surface.area.sum() > 0:
        raise ValueError(f"{mesh.name}: expected faces with an area, got {len(mesh.faces)} faces without any")
    found = plan(surface, Rays(mesh.vertices, mesh.faces), Sphere.of(mesh.vertices), wish, sphere(directions))
    studio = Studio(mesh, supersample)
    shots = [studio.shoot(towards, wish.distance, size_px) for towards in found.towards]
    names = (*CARDINAL, *(f"added_{n}" for n in range(1, len(shots) - len(CARDINAL) + 1)))
    visible = np.bincount(surface.face, np.where(found.visible, surface.area, 0), len(mesh.faces))
    return ObjectViews(
        mesh.name, names, np.stack([s.rgb for s in shots]), np.stack([s.face for s in shots]), np.stack([s.depth_m for s in shots]),
        np.stack([s.camera.K for s in shots]), np.stack([s.camera.T_world_cam for s in shots]), visible.astype(np.float32),
        found.share)  # fmt: skip
