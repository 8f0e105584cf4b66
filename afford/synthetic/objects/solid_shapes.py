"""Closed solids for building objects: revolved, swept, lofted and extruded shapes, handles and blades. Metres, z up.

All shapes are a `manifold3d.Manifold`, which is closed and oriented by construction, so that unions are exact. Handles end at y
= 0, where the tool begins.
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
"""Number of corners of round sections."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Closed piece of an object, and the semantic part of its surface."""

    part: str
    shape: Manifold


def closed(vertices: np.ndarray, faces: np.ndarray) -> Manifold:
    """Build a solid from vertices (v, 3) and faces (f, 3), welded and oriented outwards. Raises ValueError for an open surface."""
    points, index = np.unique(np.asarray(vertices, np.float64) + 0.0, axis=0, return_inverse=True)
    corner = index.reshape(-1)[faces].astype(np.uint64)
    whole = corner[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    tri = points[whole]
    inside_out = np.einsum("fi,fi->", np.cross(tri[:, 0], tri[:, 1]), tri[:, 2]) < 0
    shape = Manifold(Mesh64(points, np.ascontiguousarray(whole[:, ::-1] if inside_out else whole)))
    if shape.status() != Error.NoError:
        raise ValueError(f"solid of {len(whole)} faces: expected a closed surface, got {shape.status().name}; close its ends")
    return shape


def revolve(profile: ArrayLike, sides: int = 2 * SIDES) -> Manifold:
    """Build a solid of revolution about z from `profile` (n, 2) of (radius, height).

    The profile begins and ends on the axis, or is closed.
    """
    line = np.asarray(profile, float)
    shape = solids.lathe(line, sides, crease_deg=180.0)
    return closed(shape.vertices, shape.faces).rotate((0, 0, np.degrees(_phase(line, sides))))


def lay_along_y(shape: Manifold) -> Manifold:
    """Rotate a shape along z so that it lies along +y."""
    return shape.rotate((-90.0, 0.0, 0.0))


def sweep(path: ArrayLike, radius: ArrayLike, flat: float = 1.0, up: tuple[float, float, float] = (0, 0, 1),
          sides: int = SIDES) -> Manifold:  # fmt: skip
    """Sweep an ellipse of `radius` (n,) across, times `flat` along `up`, along `path` (n, 3)."""
    shape = solids.tube(np.asarray(path, float), np.asarray(radius, float), sides, flat=flat, up=up)
    return closed(shape.vertices, shape.faces)


def loft(rings: ArrayLike) -> Manifold:
    """Loft a solid over `rings` (n, m, 3) of m corners each, closed at both ends. Sections must be star-shaped."""
    ring = np.asarray(rings, float)
    ends = np.stack([ring[0].mean(axis=0), ring[-1].mean(axis=0)])
    first, last = (np.repeat(end[None], ring.shape[1], axis=0)[None] for end in ends)
    grid = np.concatenate([first, ring, last])
    grid = np.concatenate([grid, grid[:, :1]], axis=1)
    return closed(grid.reshape(-1, 3), grid_faces(*grid.shape[:2]))


def block(size: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0), bevel: float = 0.001) -> Manifold:
    """Build a box with bevelled edges, centred at `at`."""
    shape = solids.box(size, bevel)
    return closed(shape.vertices, shape.faces).translate((at[0], at[1], at[2] - size[2] / 2))


def sheet(outline: ArrayLike, thickness: float, holes: tuple[ArrayLike, ...] = (), round_m: float = 0.0) -> Manifold:
    """Extrude a flat outline (n, 2) with holes, centred at z = 0, with corners rounded by `round_m`."""
    flat = CrossSection([_counter_clockwise(outline)])
    for hole in holes:
        flat = flat - CrossSection([_counter_clockwise(hole)])
    if round_m:
        flat = flat.offset(-round_m).offset(2 * round_m, JoinType.Round, 2.0, SIDES).offset(-round_m, JoinType.Round, 2.0, SIDES)
        flat = flat.simplify(1e-4)
    return Manifold.extrude(flat, thickness).translate((0, 0, -thickness / 2))


def bar(y: ArrayLike, half_x: ArrayLike, half_z: ArrayLike, x: ArrayLike = 0.0, z: ArrayLike = 0.0, *, square: float = 2.0,
        sides: int = SIDES) -> Manifold:  # fmt: skip
    """Build a bar along y with superelliptic sections (`square` 2: ellipse, 5: nearly a box) of half sizes (n,) about (x, z)."""
    along, *rest = np.broadcast_arrays(*(np.asarray(v, float) for v in (y, half_x, half_z, x, z)))
    a = np.linspace(0, 2 * np.pi, sides, endpoint=False) + _phase(np.stack([along, *rest]), sides)
    c, s = (np.sign(w) * np.abs(w) ** (2 / square) for w in (np.cos(a), np.sin(a)))
    wide, tall, right, high = (v[:, None] for v in rest)
    return loft(np.stack(np.broadcast_arrays(right + wide * c, along[:, None], high + tall * s), axis=-1))


def plate(middle: ArrayLike, thick: float) -> Manifold:
    """Build a curved plate from a grid of points `middle` (n, m, 3), with thickness `thick` along z."""
    grid, up = np.asarray(middle, float), np.array([0, 0, thick / 2])
    skin = np.concatenate([grid + up, grid[:, ::-1] - up], axis=1)
    fold = np.concatenate([grid, grid[:, ::-1]], axis=1)
    rings = np.concatenate([fold[:1], skin, fold[-1:]])
    rings = np.concatenate([rings, rings[:, :1]], axis=1)
    return closed(rings.reshape(-1, 3), grid_faces(*rings.shape[:2]))


def wire(points: ArrayLike, radius: float, round_m: float, flat: float = 1.0, sides: int = 14) -> Manifold:
    """Sweep a wire along line segments through `points` (n, 3) in a plane of constant z, with bends rounded over `round_m`."""
    knots = np.asarray(points, float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    step = round_m / 4
    t = np.linspace(0, at[-1], max(int(at[-1] / step), 2))
    line = np.stack([np.interp(t, at, axis) for axis in knots.T], axis=-1)
    smooth = gaussian_filter1d(line, 3.0, axis=0, mode="nearest")
    smooth[[0, -1]] = knots[[0, -1]]
    return sweep(smooth, radius, flat, sides=sides)


def hoop(radius_x: float, radius_y: float, thick: float, flat: float = 1.0) -> Manifold:
    """Build an elliptic torus in the plane z = 0, from its half sizes, half thickness and flattening along z."""
    a = np.linspace(0, 2 * np.pi, 15)
    wire = np.stack([radius_x + thick * np.cos(a), thick * np.sin(a)], axis=-1)
    wire[-1] = wire[0]
    return revolve(wire).scale((1.0, radius_y / radius_x, flat))


def curve(points: ArrayLike, count: int) -> np.ndarray:
    """Return points (count, k) of a smooth monotone curve through `points` (n, k)."""
    knots = np.asarray(points, float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return np.asarray(PchipInterpolator(at, knots)(np.linspace(0, at[-1], count)))


def capped(start: float, stop: float, cap: float, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Return stations (count,), denser at the ends, and the width (count,) as a share 0..1 that rounds both ends."""
    t = (1 - np.cos(np.pi * np.linspace(0, 1, count))) / 2
    short = np.clip(np.minimum(t, 1 - t) * abs(stop - start) / cap, 0, 1)
    return start + t * (stop - start), np.maximum(np.sqrt(1 - (1 - short) ** 2), 0.2)


def _phase(numbers: np.ndarray, sides: int) -> float:
    """Return an angle that differs between shapes, so that edges of coaxial solids never coincide and leave slivers in a union."""
    return float(np.abs(numbers).sum() * 1e4 % 1 * 2 * np.pi / sides)


def _counter_clockwise(outline: ArrayLike) -> np.ndarray:
    """Return the outline in counter-clockwise order."""
    line = np.asarray(outline, float)
    x, y = line.T
    area = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))
    return np.ascontiguousarray(line if area > 0 else line[::-1])


OVERLAP_M = 0.004
"""Overlap of neighbouring pieces, metres, so that their union is one body."""


def bar_grip(rng: np.random.Generator, length: float, half_x: float, half_z: float) -> Manifold:
    """A handle from y = -length to just past 0: straight, swelling, tapering or waisted; round to nearly square."""
    y, envelope = capped(-length, OVERLAP_M, 1.1 * min(half_x, half_z))
    s = (y + length) / length
    swell = 1 + rng.uniform(0, 0.16) * np.sin(2 * np.pi * (rng.uniform(0.5, 1.6) * s + rng.random()))
    taper = 1 + rng.uniform(-0.12, 0.16) * (1 - 2 * s)
    bow = rng.uniform(-0.05, 0.05) * length * s * (1 - s)
    return bar(y, half_x * swell * taper * envelope, half_z * taper * envelope, x=bow, square=rng.uniform(2.0, 4.5))


def knob_grip(rng: np.random.Generator, length: float, radius: float, flutes: int = 0) -> Manifold:
    """A turned handle from y = -length to just past 0: pommel, belly and neck; `flutes` adds ribs."""
    belly, neck, pommel = rng.uniform(0.40, 0.60), rng.uniform(0.58, 0.78), rng.uniform(0.80, 0.98)
    t = np.array([0, 0.012, 0.06, belly * 0.6, belly, 0.80, 0.92, 1.0])
    r = radius * np.array([0.30, 0.55, pommel, 0.98, 1.0, neck, neck + 0.12, neck])
    line = np.stack([r, t * (length + OVERLAP_M)], axis=-1)
    shape = revolve(np.concatenate([[(0, 0)], line, [(0, length + OVERLAP_M)]]), 32)
    for turn in np.arange(flutes) * 360 / max(flutes, 1):
        groove = bar([0.12 * length, 0.2 * length, 0.65 * length, 0.72 * length], 0.19 * radius * np.array([0.3, 1, 1, 0.3]),
                     0.15 * radius, z=1.04 * radius, sides=10)  # fmt: skip
        shape = shape - stand_along_z(groove).rotate((0, 0, float(turn)))
    return lay_along_y(shape).translate((0, -length, 0))


def stand_along_z(shape: Manifold) -> Manifold:
    """Rotate a shape along +y so that it stands along z."""
    return shape.rotate((90.0, 0.0, 0.0))


def blade(y: np.ndarray, spine: np.ndarray, edge: np.ndarray, thick: float, ground: float = 0.5) -> Manifold:
    """A ground blade in the plane z = 0 that extends in x from `spine` to `edge` at each station y (n,).

    From the share `ground` of its width it thins to the edge.
    """
    shoulder = spine + ground * (edge - spine)
    t = thick / 2 * np.clip(np.abs(edge - spine) / np.abs(edge - spine).max() / 0.3, 0.25, 1)
    e = np.full_like(t, 0.00025)
    corners = [(spine, t), (shoulder, t), (edge, e), (edge, -e), (shoulder, -t), (spine, -t)]
    return loft(np.stack([np.stack([x, y, z], axis=-1) for x, z in corners], axis=1))


def t_grip(rng: np.random.Generator, wide: float, radius: float) -> Manifold:
    """A T handle: a crossbar, `wide` from end to end, on a stub that ends just past 0."""
    x, envelope = capped(-wide / 2, wide / 2, radius, 24)
    swell = 1 + rng.uniform(-0.15, 0.25) * np.cos(np.pi * x / wide)
    across = bar(x, radius * envelope * swell, rng.uniform(0.8, 1.0) * radius * envelope, square=rng.uniform(2.0, 3.0))
    stub = lay_along_y(revolve([(0, -1.6 * radius), (0.9 * radius, -1.6 * radius), (0.85 * radius, OVERLAP_M), (0, OVERLAP_M)], 28))
    return across.rotate((0, 0, 90)).translate((0, -1.8 * radius, 0)) + stub


def d_grip(rng: np.random.Generator, wide: float, long: float, radius: float) -> Manifold:
    """A D handle: a crossbar, `wide` from end to end, between two arms that meet just past 0, `long` away."""
    half, bow = wide / 2 - radius, rng.uniform(1.3, 1.9)
    y = np.linspace(OVERLAP_M, radius - long, 16)
    x = half * np.sin(np.pi / 2 * np.linspace(0, 1, 16) ** bow)
    arms = [sweep(np.stack([side * x, y, 0 * y], -1), 0.85 * radius, sides=16) for side in (-1, 1)]
    s, envelope = capped(-wide / 2, wide / 2, radius, 20)
    across = bar(s, radius * envelope, radius * envelope).rotate((0, 0, 90)).translate((0, radius - long, 0))
    return arms[0] + arms[1] + across


def ring_grip(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A ring handle for a finger or a hand, on a stub that ends just past 0."""
    round_y = rng.uniform(0.75, 1.35) * radius
    stub = lay_along_y(revolve([(0, -0.8 * thick), (1.1 * thick, -0.8 * thick), (0.9 * thick, OVERLAP_M), (0, OVERLAP_M)], 24))
    return hoop(radius, round_y, thick, rng.uniform(0.8, 1.2)).translate((0, -round_y - 0.5 * thick, 0)) + stub
