"""Closed solids out of which objects are put together: turned, swept, lofted, cut out of a sheet. Metres, z up.

All return a `manifold3d.Manifold`, which is closed and oriented by construction, so that unions of them are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, Error, JoinType, Manifold, Mesh64
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from afford.render import solids
from afford.render.solids import grid_faces

SIDES = 24
"""Corners of round sections."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed piece of an object, and the semantic part that its surface belongs to."""

    part: str
    shape: Manifold


def closed(vertices: np.ndarray, faces: np.ndarray) -> Manifold:
    """Vertices (v, 3) and faces (f, 3), welded where they coincide and turned outwards; ValueError when they leave a gap."""
    points, index = np.unique(np.asarray(vertices, np.float64) + 0.0, axis=0, return_inverse=True)
    corner = index.reshape(-1)[faces].astype(np.uint64)
    whole = corner[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    tri = points[whole]
    inside_out = np.einsum("fi,fi->", np.cross(tri[:, 0], tri[:, 1]), tri[:, 2]) < 0
    shape = Manifold(Mesh64(points, np.ascontiguousarray(whole[:, ::-1] if inside_out else whole)))
    if shape.status() != Error.NoError:
        raise ValueError(f"solid of {len(whole)} faces: expected a closed surface, got {shape.status().name}; close its ends")
    return shape


def turned(profile: ArrayLike, sides: int = 2 * SIDES) -> Manifold:
    """A solid of revolution about z. `profile` (n, 2) of (radius, height) begins and ends on the axis, or where it began."""
    line = np.asarray(profile, float)
    shape = solids.lathe(line, sides, crease_deg=180.0)
    return closed(shape.vertices, shape.faces).rotate((0, 0, np.degrees(_phase(line, sides))))


def laid(shape: Manifold) -> Manifold:
    """What stands along z, laid along +y."""
    return shape.rotate((-90.0, 0.0, 0.0))


def swept(path: ArrayLike, radius: ArrayLike, flat: float = 1.0, up: tuple[float, float, float] = (0, 0, 1),
          sides: int = SIDES) -> Manifold:  # fmt: skip
    """An ellipse of `radius` (n,) across, times `flat` along `up`, swept along `path` (n, 3)."""
    shape = solids.tube(np.asarray(path, float), np.asarray(radius, float), sides, flat=flat, up=up)
    return closed(shape.vertices, shape.faces)


def loft(rings: ArrayLike) -> Manifold:
    """The skin over `rings` (n, m, 3) of m corners each, closed at both ends. Sections must be star-shaped."""
    ring = np.asarray(rings, float)
    ends = np.stack([ring[0].mean(axis=0), ring[-1].mean(axis=0)])
    first, last = (np.repeat(end[None], ring.shape[1], axis=0)[None] for end in ends)
    grid = np.concatenate([first, ring, last])
    grid = np.concatenate([grid, grid[:, :1]], axis=1)
    return closed(grid.reshape(-1, 3), grid_faces(*grid.shape[:2]))


def block(size: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0), bevel: float = 0.001) -> Manifold:
    """A box about the point `at`, its edges cut."""
    shape = solids.box(size, bevel)
    return closed(shape.vertices, shape.faces).translate((at[0], at[1], at[2] - size[2] / 2))


def sheet(outline: ArrayLike, thickness: float, holes: tuple[ArrayLike, ...] = (), round_m: float = 0.0) -> Manifold:
    """A flat outline (n, 2) with holes, corners rounded by `round_m`, of a thickness about z = 0."""
    flat = CrossSection([_wound(outline)])
    for hole in holes:
        flat = flat - CrossSection([_wound(hole)])
    if round_m:
        flat = flat.offset(-round_m).offset(2 * round_m, JoinType.Round, 2.0, SIDES).offset(-round_m, JoinType.Round, 2.0, SIDES)
        flat = flat.simplify(1e-4)
    return Manifold.extrude(flat, thickness).translate((0, 0, -thickness / 2))


def bar(y: ArrayLike, half_x: ArrayLike, half_z: ArrayLike, x: ArrayLike = 0.0, z: ArrayLike = 0.0, *, square: float = 2.0,
        sides: int = SIDES) -> Manifold:  # fmt: skip
    """A bar along y whose sections are superellipses (`square` 2: ellipse, 5: nearly a box) of half sizes (n,) about (x, z)."""
    along, *rest = np.broadcast_arrays(*(np.asarray(v, float) for v in (y, half_x, half_z, x, z)))
    a = np.linspace(0, 2 * np.pi, sides, endpoint=False) + _phase(np.stack([along, *rest]), sides)
    c, s = (np.sign(w) * np.abs(w) ** (2 / square) for w in (np.cos(a), np.sin(a)))
    wide, tall, right, high = (v[:, None] for v in rest)
    return loft(np.stack(np.broadcast_arrays(right + wide * c, along[:, None], high + tall * s), axis=-1))


def plate(middle: ArrayLike, thick: float) -> Manifold:
    """A curved plate: `middle` (n, m, 3) is a grid of points on it, `thick` its thickness along z."""
    grid, up = np.asarray(middle, float), np.array([0, 0, thick / 2])
    skin = np.concatenate([grid + up, grid[:, ::-1] - up], axis=1)
    fold = np.concatenate([grid, grid[:, ::-1]], axis=1)
    rings = np.concatenate([fold[:1], skin, fold[-1:]])
    rings = np.concatenate([rings, rings[:, :1]], axis=1)
    return closed(rings.reshape(-1, 3), grid_faces(*rings.shape[:2]))


def wire(points: ArrayLike, radius: float, round_m: float, flat: float = 1.0, sides: int = 14) -> Manifold:
    """A wire along straight lines through `points` (n, 3) in a plane of constant z, its bends rounded over `round_m`."""
    knots = np.asarray(points, float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    step = round_m / 4
    t = np.linspace(0, at[-1], max(int(at[-1] / step), 2))
    line = np.stack([np.interp(t, at, axis) for axis in knots.T], axis=-1)
    smooth = gaussian_filter1d(line, 3.0, axis=0, mode="nearest")
    smooth[[0, -1]] = knots[[0, -1]]
    return swept(smooth, radius, flat, sides=sides)


def hoop(radius_x: float, radius_y: float, thick: float, flat: float = 1.0) -> Manifold:
    """A torus lying on z = 0's plane: half sizes to the middle of its wire, half thickness, and that of z as a share of it."""
    a = np.linspace(0, 2 * np.pi, 15)
    wire = np.stack([radius_x + thick * np.cos(a), thick * np.sin(a)], axis=-1)
    wire[-1] = wire[0]
    return turned(wire).scale((1.0, radius_y / radius_x, flat))


def curve(points: ArrayLike, count: int) -> np.ndarray:
    """(count, k) points of a smooth line through `points` (n, k) that never swings past them."""
    knots = np.asarray(points, float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return np.asarray(PchipInterpolator(at, knots)(np.linspace(0, at[-1], count)))


def capped(start: float, stop: float, cap: float, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """(count,) stations from start to stop, denser at the ends, and the share 0..1 of the full width that rounds both ends."""
    t = (1 - np.cos(np.pi * np.linspace(0, 1, count))) / 2
    short = np.clip(np.minimum(t, 1 - t) * abs(stop - start) / cap, 0, 1)
    return start + t * (stop - start), np.maximum(np.sqrt(1 - (1 - short) ** 2), 0.2)


def _phase(numbers: np.ndarray, sides: int) -> float:
    """An angle of its own for every shape, so that no two solids on one axis meet edge on edge, where a union leaves slivers."""
    return float(np.abs(numbers).sum() * 1e4 % 1 * 2 * np.pi / sides)


def _wound(outline: ArrayLike) -> np.ndarray:
    """The outline, counter-clockwise."""
    line = np.asarray(outline, float)
    x, y = line.T
    area = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))
    return np.ascontiguousarray(line if area > 0 else line[::-1])
