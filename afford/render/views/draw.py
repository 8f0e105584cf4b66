"""Render views of an object with the exact face of every pixel, and contact sheets of them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from afford.render.camera import CARDINAL, Sphere, camera
from afford.render.draw import render
from afford.render.mesh import Mesh, has_area, mesh
from afford.render.raster import View, depth
from afford.render.scene import Camera, Instance, Light, Material, Textures, batch
from afford.render.views.plan import ViewSettings, plan_views
from afford.render.views.surface import Rays, Surface, fibonacci_sphere
from schemas.mesh import ObjectMesh, ObjectViews

BACKGROUND = 235
"""grey of the image background"""
LARGEST_PX = 2048
"""largest side of a texture"""
CREASE_DEG = 40.0
LAMP = Light(colour=(1.25, 1.2, 1.1), ceiling=(0.1, 0.1, 0.1), sky=(0.62, 0.62, 0.64), ground=(0.5, 0.49, 0.48), softness=0.05,
             vignette=0.0)  # fmt: skip


class Shot(NamedTuple):
    """View: camera, colours (h, w, 3) uint8, faces (h, w) int32 (-1 background), depth (h, w) float32 metres."""

    camera: Camera
    rgb: np.ndarray
    face: np.ndarray
    depth_m: np.ndarray


class Studio:
    """One object in front of a plain wall, with a light at the camera."""

    def __init__(self, thing: ObjectMesh, supersample: int = 2) -> None:
        self._vertices, self._supersample = thing.vertices.astype(np.float64), supersample
        self._sphere = Sphere.of(thing.vertices)
        self._faces = np.flatnonzero(has_area(thing.vertices, thing.faces)).astype(np.int32)
        self._instances = (Instance(drawable(thing), material(thing.texture), entity=0),)
        self._textures = Textures.of(i.material for i in self._instances)

    def shoot(self, towards: np.ndarray, distance: float, size_px: int) -> Shot:
        """Render a square view from `distance` radii away in the direction `towards` (3,)."""
        cam = camera(self._vertices, self._sphere, towards, distance, size_px)
        rgb = render(self._instances, cam, self._light(cam), self._textures, supersample=self._supersample).rgb
        view = View.of(batch(self._instances, self._textures), cam)
        seen, near = view.seen(1)[1]
        covered = view.seen(self._supersample)[1][0] >= 0
        return Shot(cam, _before_wall(rgb, covered), np.append(self._faces, np.int32(-1))[seen], depth(near))

    def _light(self, cam: Camera) -> Light:
        """Light from the camera's upper left, with strong ambience, so that no side is dark."""
        R = cam.T_world_cam[:3, :3]
        x, y, z = (R @ np.array([0.35, 0.5, 1.0])).tolist()
        a, b, c = self._sphere.centre.tolist()
        return replace(LAMP, direction=(x, y, z), centre=(a, b, c), radius_m=1.2 * self._sphere.radius_m)


def drawable(thing: ObjectMesh) -> Mesh:
    """Convert to a render mesh with a vertex for each corner of a face, since uv belongs to corners."""
    corners = np.arange(3 * len(thing.faces), dtype=np.int32).reshape(-1, 3)
    uv = np.stack([thing.uv[..., 0], 1 - thing.uv[..., 1]], -1).reshape(-1, 2)
    return mesh(thing.vertices[thing.faces.reshape(-1)], corners, uv, crease_deg=CREASE_DEG)


def material(texture: np.ndarray) -> Material:
    """Convert a texture (a, b, 3) uint8 of any size to a material whose sides are powers of two."""
    tall, wide = (min(1 << (side - 1).bit_length(), LARGEST_PX) for side in texture.shape[:2])
    same = (tall, wide) == texture.shape[:2]
    return Material(texture if same else cv2.resize(texture, (wide, tall), interpolation=cv2.INTER_AREA), roughness=0.6)


def _before_wall(rgb: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Blend the wall into pixels with uncovered samples (h * s, w * s)."""
    height, width = rgb.shape[:2]
    share = covered.reshape(height, covered.shape[0] // height, width, -1).mean((1, 3), dtype=np.float32)
    return np.asarray(rgb + np.rint((1 - share) * BACKGROUND).astype(np.uint8)[..., None])


def render_views(mesh: ObjectMesh, settings: ViewSettings, directions: int, size_px: int, supersample: int) -> ObjectViews:
    """Plan and render all views of one object; ValueError for a mesh without surface."""
    surface = Surface.of(mesh)
    if not surface.area.sum() > 0:
        raise ValueError(f"{mesh.name}: expected faces with an area, got {len(mesh.faces)} faces without any")
    found = plan_views(surface, Rays(mesh.vertices, mesh.faces), Sphere.of(mesh.vertices), settings, fibonacci_sphere(directions))
    studio = Studio(mesh, supersample)
    shots = [studio.shoot(towards, settings.distance, size_px) for towards in found.towards]
    names = (*CARDINAL, *(f"added_{n}" for n in range(1, len(shots) - len(CARDINAL) + 1)))
    visible = np.bincount(surface.face, np.where(found.visible, surface.area, 0), len(mesh.faces))
    return ObjectViews(
        mesh.name, names, np.stack([s.rgb for s in shots]), np.stack([s.face for s in shots]), np.stack([s.depth_m for s in shots]),
        np.stack([s.camera.K for s in shots]), np.stack([s.camera.T_world_cam for s in shots]), visible.astype(np.float32),
        found.share)  # fmt: skip


COLUMNS = 3
PAPER = 235
"""grey of the sheet"""
LINE_PX = 24
"""height of the caption above each image"""


def sheet_labels(views: ObjectViews, count: int) -> tuple[str, ...]:
    """Return the names of the views on the sheet, row by row."""
    return views.views[:count]


def contact_sheet(views: ObjectViews, count: int) -> np.ndarray:
    """Draw a sheet (h, w, 3) uint8 of the first `count` views, three in a row, each under its name."""
    tiles = [_titled(picture, name) for picture, name in zip(views.rgb[:count], sheet_labels(views, count), strict=True)]
    columns = min(COLUMNS, len(tiles))
    tiles += [np.full_like(tiles[0], PAPER)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[at : at + columns], axis=1) for at in range(0, len(tiles), columns)]
    return np.concatenate(rows, axis=0)


def _titled(picture: np.ndarray, name: str) -> np.ndarray:
    line = np.full((LINE_PX, *picture.shape[1:]), PAPER, np.uint8)
    cv2.putText(line, name, (6, LINE_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1, cv2.LINE_AA)
    return np.concatenate([line, picture], axis=0)
