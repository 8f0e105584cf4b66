"""Soft shadows: shadow maps of parallel lights with percentage-closer soft shadows (Fernando 2005)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from afford.render.scene import Batch, Camera, Light

SIZE = 768
FAR = np.float32(1e6)


@dataclass(frozen=True, eq=False)
class Lamp:
    """Parallel light; `frame` (3, 4) float32 maps world to (texel x, texel y, depth in metres along the light)."""

    frame: np.ndarray
    texel_m: float
    softness: float
    colour: np.ndarray


def lamps(light: Light) -> list[Lamp]:
    """Return the key light and the broad light from above."""
    key = _lamp(light, light.direction, light.softness, light.colour)
    above = _lamp(light, (0.08, 0.12, -1.0), 0.55, light.ceiling)
    return [key, above]


def _lamp(light: Light, direction: tuple[float, float, float], softness: float, colour: tuple[float, float, float]) -> Lamp:
    along = np.asarray(direction, float) / np.linalg.norm(direction)
    right = np.cross(along, (0.0, 1.0, 0.1))
    right /= np.linalg.norm(right)
    texel = 2 * light.radius_m / SIZE
    rows = np.stack([right / texel, np.cross(along, right) / texel, along])
    offset = np.array([SIZE / 2, SIZE / 2, 0]) - rows @ np.asarray(light.centre)
    return Lamp(np.c_[rows, offset].astype(np.float32), texel, softness, np.asarray(colour, np.float32))


def depth_maps(scene: Batch, lamp: Lamp, last: frozenset[int], full: np.ndarray, bare: np.ndarray) -> None:
    """Draw shadow maps (SIZE, SIZE): `full` of all entities, `bare` without the entities in `last`."""
    points = (scene.vertices @ lamp.frame[:, :3].T + lamp.frame[:, 3]).astype(np.float32)
    late = np.isin(scene.entity, list(last))
    _fill_depth(points, scene.faces, (scene.casts & ~late)[scene.part], bare)
    if last:
        full[:] = bare
        _fill_depth(points, scene.faces, (scene.casts & late)[scene.part], full)


def search_radius(lamp: Lamp) -> float:
    """Return the blocker search radius around a point of a shadow map, in texels."""
    return min(0.12 * lamp.softness / lamp.texel_m + 2.0, 40.0)


@numba.njit(cache=True, fastmath=True)
def _fill_depth(points, faces, keep, out):  # type: ignore[no-untyped-def]  # numba infers
    for f in range(len(faces)):
        if not keep[f]:
            continue
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-9:
            continue
        x0, x1 = max(0, int(min(a[0], b[0], c[0]))), min(SIZE - 1, int(max(a[0], b[0], c[0])) + 1)
        y0, y1 = max(0, int(min(a[1], b[1], c[1]))), min(SIZE - 1, int(max(a[1], b[1], c[1])) + 1)
        inv = 1.0 / area
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) * inv
                v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) * inv
                if u >= 0 and v >= 0 and u + v <= 1:
                    z = u * a[2] + v * b[2] + (1 - u - v) * c[2]
                    if z < out[y, x]:
                        out[y, x] = z


def _spiral(count: int) -> np.ndarray:
    """Spread (count, 2) points evenly in the unit disk (Vogel)."""
    k = np.arange(count) + 0.5
    turn = k * 2.399963229728653
    return (np.sqrt(k / count)[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)).astype(np.float32)


DISK = _spiral(24)
SEARCH = _spiral(12)


@numba.njit(cache=True, fastmath=True)
def lamp_visibility(maps, n, x, y, z, softness, texel_m):  # type: ignore[no-untyped-def]
    """Compute the visible share 0..1 of the lamp from light-space (x, y texels, z metres)."""
    search_radius = min(np.float32(0.12) * softness / texel_m + np.float32(2.0), np.float32(40.0))
    total, blockers = np.float32(0.0), 0
    for k in range(len(SEARCH)):
        i, j = int(y + SEARCH[k, 1] * search_radius + 0.5), int(x + SEARCH[k, 0] * search_radius + 0.5)
        if 0 <= i < SIZE and 0 <= j < SIZE and maps[n, i, j] < z:
            total += maps[n, i, j]
            blockers += 1
    if blockers == 0:
        return np.float32(1.0)
    radius = min(max((z - total / blockers) * softness / texel_m, 1.5), search_radius)
    share = np.float32(0.0)
    for k in range(len(DISK)):
        share += _compare(maps, n, x + DISK[k, 0] * radius, y + DISK[k, 1] * radius, z)
    return share / np.float32(len(DISK))


@numba.njit(cache=True, fastmath=True)
def _compare(maps, n, x, y, z):  # type: ignore[no-untyped-def]
    """Interpolate the share of the four texels around (x, y) that do not block."""
    j, i = int(x), int(y)
    if i < 0 or j < 0 or i >= SIZE - 1 or j >= SIZE - 1:
        return np.float32(1.0)
    s, t = np.float32(x - j), np.float32(y - i)
    one, none = np.float32(1.0), np.float32(0.0)
    a = one if maps[n, i, j] >= z else none
    b = one if maps[n, i, j + 1] >= z else none
    c = one if maps[n, i + 1, j] >= z else none
    d = one if maps[n, i + 1, j + 1] >= z else none
    return (a * (one - s) + b * s) * (one - t) + (c * (one - s) + d * s) * t


CELL = 8
"""shadow maps are compared in cells of this many texels"""


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lights and ambience in the form of the kernel, with shadow maps.

    `full` and `bare` (lamps, SIZE, SIZE) are the depth maps with and without the entities that are drawn last.
    """

    lamps: tuple[Lamp, ...]
    rows: np.ndarray
    ambience: np.ndarray
    vignette: float
    full: np.ndarray
    bare: np.ndarray

    @staticmethod
    def of(scene: Batch, light: Light, last: frozenset[int] = frozenset()) -> Lighting:
        """Draw the shadow maps of a scene."""
        both = tuple(lamps(light))
        rows = [np.concatenate([la.frame.reshape(-1), -la.frame[2, :3], la.colour, [la.softness, la.texel_m]]) for la in both]
        ambience = np.array([light.sky, light.ground, [light.exposure] * 3], np.float32)
        full = np.full((len(both), SIZE, SIZE), FAR, np.float32)
        bare = full.copy() if last else full
        for lamp, all_, some in zip(both, full, bare, strict=True):
            depth_maps(scene, lamp, last, all_, some)
        return Lighting(both, np.array(rows, np.float32), ambience, light.vignette, full, bare)

    def touched(self, camera: Camera, depth_m: np.ndarray) -> np.ndarray:
        """Find pixels (h, w) bool, at depths (h, w), whose light may differ between the two sets of maps."""
        out = np.zeros(depth_m.shape, np.bool_)
        for lamp, full, bare in zip(self.lamps, self.full, self.bare, strict=True):
            cells = (full != bare).reshape(SIZE // CELL, CELL, SIZE // CELL, CELL).any(axis=(1, 3)).astype(np.uint8)
            around = 2 * (int(np.ceil((search_radius(lamp) + 4) / CELL)) + 1) + 1
            near = cv2.dilate(cells, np.ones((around, around), np.uint8))
            column, row = (
                np.clip(texel / CELL, 0, SIZE // CELL - 1).astype(np.int32) for texel in _texels(lamp, camera, depth_m)
            )
            out |= near[row, column] > 0
        return out


def _texels(lamp: Lamp, camera: Camera, depth_m: np.ndarray) -> list[np.ndarray]:
    """Map pixels at these depths to shadow map coordinates x and y, each (h, w)."""
    rays = lamp.frame[:2, :3] @ camera.T_world_cam[:3, :3] @ np.linalg.inv(camera.K)
    start = lamp.frame[:2, :3] @ camera.T_world_cam[:3, 3] + lamp.frame[:2, 3]
    y, x = np.ogrid[0 : camera.height, 0 : camera.width]
    return [
        depth_m * (ray[0] * x + ray[1] * y + ray[2]).astype(np.float32) + np.float32(s)
        for ray, s in zip(rays, start, strict=True)
    ]
