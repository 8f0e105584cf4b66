"""Tableware and baking tools: wine glass, teapot, pizza cutter, rolling pin. Vessels stand; the others lie, handle towards -y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import (
    Solid,
    bar,
    bar_grip,
    capped,
    curve,
    knob_grip,
    lay_along_y,
    revolve,
    ring_grip,
    sweep,
)
from afford.synthetic.objects.vessels import arch_above, bow_behind, knob_on, spout_along

BOWLS = {
    "wine": [(0.0, 0.0), (0.45, 0.03), (0.92, 0.28), (1.0, 0.45), (0.86, 0.78), (0.72, 1.0)],
    "flute": [(0.0, 0.0), (0.5, 0.08), (0.9, 0.35), (1.0, 0.6), (0.92, 1.0)],
    "coupe": [(0.0, 0.0), (0.5, 0.05), (0.86, 0.35), (1.0, 0.75), (1.0, 1.0)],
    "cone": [(0.0, 0.0), (0.12, 0.04), (0.5, 0.42), (1.0, 1.0)],
    "tulip": [(0.0, 0.0), (0.7, 0.06), (1.0, 0.32), (0.82, 0.72), (0.98, 1.0)],
}
"""Profiles of glasses: radius and height as shares of the largest."""
SIZES_M = {"wine": (0.037, 0.09), "flute": (0.025, 0.13), "coupe": (0.047, 0.05), "cone": (0.052, 0.065), "tulip": (0.036, 0.085)}


def wine_glass(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A stemmed glass for wine, sparkling wine or cocktails, with a long or short, smooth or knotted stem."""
    kind = str(rng.choice(list(BOWLS)))
    radius, tall = np.array(SIZES_M[kind]) * rng.uniform(0.85, 1.2, 2)
    wall, long = rng.uniform(0.0018, 0.0028), rng.uniform(0.025, 0.105)
    outer = curve(np.array(BOWLS[kind]) * [radius, tall], 30)
    way = np.gradient(outer, axis=0)
    inner = outer + wall * np.stack([-way[:, 1], way[:, 0]], -1) / np.linalg.norm(way, axis=1)[:, None]
    inner = inner[(inner[:, 0] > 0.0005) & (inner[:, 1] > 1.2 * wall)]
    inner[-1, 1] = tall
    bowl = revolve(np.concatenate([outer, inner[::-1], [(0, inner[0, 1])]])).translate((0, 0, long))
    rim = _bead(outer, inner[-1, 0], rng.uniform(0.0065, 0.0105), rng.uniform(0.0005, 0.0010)).translate((0, 0, long))
    foot, thin = rng.uniform(0.75, 1.05) * max(radius, 0.032), rng.uniform(0.0030, 0.0052)
    base = revolve([(0, 0), (foot, 0), (foot, 0.0022), (0.5 * foot, 0.0042), (2.0 * thin, 0.008), (0, 0.008)])
    z = np.linspace(0.004, long + 0.006, 24)
    t = (z - z[0]) / (z[-1] - z[0])
    knot = rng.choice([0.0, 0.0, rng.uniform(0.5, 1.2)]) * np.exp(-(((t - rng.uniform(0.3, 0.7)) * long / 0.008) ** 2))
    low, high = (np.clip(1 - s * long / 0.011, 0, 1) ** 2 for s in (t, 1 - t))
    girth = thin * (1 + knot + 1.2 * low + 0.8 * high)
    stem = revolve(np.concatenate([[(0, z[0])], np.stack([girth, z], -1), [(0, z[-1])]]), 28)
    return Solid("foot", base), Solid("stem", stem - _within(inner, long)), Solid("bowl", bowl), Solid("rim", rim)


def _bead(outer: np.ndarray, inside: float, deep: float, thick: float) -> Manifold:
    """Thickened upper end of a wall that extends out from `inside`."""
    top = outer[-1, 1]
    z = top + np.array([-deep, 0.0006 - deep, -0.0008, 0.0008])
    more = thick * np.array([0.6, 1.0, 1.0, 0.4])
    r = np.interp(z, outer[5:, 1], outer[5:, 0])
    wall = outer[-1, 0] - inside
    ring = np.concatenate([np.stack([r + more, z], -1), np.stack([r - wall - more, z], -1)[::-1]])
    return revolve(np.concatenate([ring, ring[:1]]))


def _within(inner: np.ndarray, z: float) -> Manifold:
    """Solid that fills a bowl with this inner profile."""
    return revolve(np.concatenate([[(0, inner[0, 1])], inner, [(0, inner[-1, 1])]])).translate((0, 0, z - 0.0005))


def teapot(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A teapot (squat, round, pear-shaped, straight or polygonal) with its handle behind or above, or a straight stick."""
    r, h = rng.uniform(0.050, 0.078), rng.uniform(0.070, 0.125)
    top, foot, belly = rng.uniform(0.38, 0.62) * r, rng.uniform(0.60, 0.95) * r, rng.uniform(0.30, 0.62)
    low, high = 0.5 * (foot + r), 0.55 * r + 0.45 * top
    line = curve([(foot, 0.0), (low, 0.4 * belly * h), (r, belly * h), (high, 0.85 * h), (top, h)], 22)
    sides = int(rng.choice([48, 48, 48, 6, 8]))
    body = revolve(np.concatenate([[(0, 0)], line, [(0, h)]]), sides)
    a = np.linspace(0, np.pi / 2, 8)
    dome = rng.uniform(0.006, 0.024)
    arch = np.stack([top * 0.92 * np.cos(a), h + 0.002 + dome * np.sin(a)], -1)
    lid = revolve([(0, h - 0.004), (top * 0.92, h - 0.004), *arch[:-1], (0, arch[-1, 1])])
    at, long, rise = rng.uniform(0.22, 0.45), rng.uniform(0.040, 0.075), rng.uniform(0.80, 1.05)
    root = float(np.interp(at * h, line[:, 1], line[:, 0])) * (1.0 if sides == 48 else 0.9)
    path = curve([(0, root - 0.018, at * h), (0, root + 0.30 * long, at * h + 0.006), (0, root + 0.62 * long, 0.60 * rise * h),
                  (0, root + long, rise * h)], 26)  # fmt: skip
    pipe, lip = spout_along(path, np.linspace(rng.uniform(0.014, 0.020), rng.uniform(0.0078, 0.0100), 26))
    kind = rng.random()
    hold = (bow_behind(rng, line, h + dome, h) if kind < 0.5 else arch_above(rng, top, h, dome) if kind < 0.75 else
            _stick(rng, line, h))  # fmt: skip
    knob = knob_on(rng.uniform(0.009, 0.014), h + dome)
    return (Solid("handle", hold), Solid("body", body), Solid("lid", lid), Solid("knob", knob), Solid("spout", pipe + lip))


def _stick(rng: np.random.Generator, line: np.ndarray, h: float) -> Manifold:
    """A straight handle at the side that rises slightly."""
    at = rng.uniform(0.5, 0.7) * h
    root = float(np.interp(at, line[:, 1], line[:, 0]))
    thick = rng.uniform(0.010, 0.014)
    bare = bar(*_tapered(rng.uniform(0.07, 0.11), thick))
    return bare.rotate((-rng.uniform(8, 30), 0, 0)).translate((0, -root + 0.008, at))


def _tapered(long: float, thick: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stations from -long to 0.012 and half sizes of a stick that swells towards its free end."""
    y, envelope = capped(-long, 0.012, thick, 20)
    half = thick * envelope * np.linspace(1.1, 0.75, 20)
    return y, half, half


def pizza_cutter(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A wheel on one or two prongs, a finger guard, and a straight, waisted or ring handle."""
    radius, axle = rng.uniform(0.028, 0.052), rng.uniform(0.012, 0.035)
    long, girth = rng.uniform(0.085, 0.125), rng.uniform(0.0105, 0.0155)
    kind = rng.random()
    hold = (knob_grip(rng, long, girth) if kind < 0.35 else ring_grip(rng, rng.uniform(0.026, 0.034), rng.uniform(0.008, 0.0105))
            if kind < 0.55 else bar_grip(rng, long, girth, rng.uniform(0.7, 1.0) * girth))  # fmt: skip
    flare, deep = rng.uniform(1.45, 2.1) * girth, rng.uniform(0.004, 0.008)
    y = np.array([-0.003, -0.001, deep - 0.001, deep + 0.001])
    collar = bar(y, flare * np.array([0.85, 1, 1, 0.85]), flare * rng.uniform(0.55, 1.0) * np.array([0.8, 1, 1, 0.8]), square=2.3)
    centre, gap = deep + axle + radius, rng.uniform(0.0020, 0.0024)
    both = rng.random() < 0.65
    prongs = [_prong(side, deep, centre, gap, rng.uniform(0.0075, 0.0105)) for side in ((-1, 1) if both else (1,))]
    rivet = Manifold.cylinder(4 * gap if both else 2 * gap, 0.005, circular_segments=20, center=both).translate((0, centre, 0))
    t = np.array([(0, -0.0012), (0.82, -0.0012), (1.0, -0.0002), (1.0, 0.0002), (0.82, 0.0012), (0, 0.0012)]) * [radius, 1]
    disc = revolve(t, 64).translate((0, centre, 0))
    web = bar([deep - 0.003, deep + axle + 0.22 * radius], 0.0066, gap, square=6.0)
    yoke = prongs[0] + prongs[-1] + rivet + (web if both else Manifold())
    return Solid("handle", hold), Solid("guard", collar), Solid("neck", yoke), Solid("wheel", disc)


def _prong(side: int, start: float, centre: float, gap: float, half: float) -> Manifold:
    """A flat arm from the guard past one face of the wheel to its middle."""
    path = curve([(0, start - 0.004, 0), (0, start + 0.003, side * 0.6 * gap), (0, start + 0.012, side * gap),
                  (0, centre, side * gap), (0, centre + 0.007, side * gap)], 20)  # fmt: skip
    return sweep(path, half * np.interp(np.linspace(0, 1, 20), [0, 0.3, 0.9, 1], [0.8, 1.0, 0.9, 0.5]), 0.2, sides=14)


def rolling_pin(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A roller with a handle at each side: turned knobs on thin necks, plain sticks, or tapering ends."""
    half, radius, long = rng.uniform(0.07, 0.15), rng.uniform(0.020, 0.036), rng.uniform(0.065, 0.11)
    kind = rng.random()
    if kind < 0.2:
        t = np.linspace(0, 1, 16)
        taper = radius * (1 - rng.uniform(0.4, 0.65) * t**0.85) * np.sqrt(np.clip(8 * (1 - t), 0.08, 1))
        line = np.concatenate([[(0, half - 0.002)], np.stack([taper, half + long * t], -1), [(0, half + long)]])
        end = lay_along_y(revolve(line))
    else:
        girth, neck = rng.uniform(0.010, 0.0145), rng.uniform(0.008, 0.020)
        held = knob_grip(rng, long - neck, girth) if kind < 0.7 else bar_grip(rng, long - neck, girth, girth)
        stub = lay_along_y(revolve([(0, -0.008), (0.6 * girth, -0.008), (0.6 * girth, neck + 0.006), (0, neck + 0.006)], 28))
        end = held.rotate((0, 0, 180)).translate((0, half + neck, 0)) + stub.translate((0, half, 0))
    bevel = rng.uniform(0.001, 0.008)
    r = radius * np.array([0, 0.9, 1.0, 1.0, 0.9, 0]) if kind >= 0.2 else radius * np.array([0, 1.0, 1.0, 1.0, 1.0, 0])
    wood = lay_along_y(revolve(np.stack([r, [-half, -half, bevel - half, half - bevel, half, half]], -1)))
    return Solid("handle", end + end.rotate((0, 0, 180))), Solid("roller", wood)


BUILDERS = {"wine_glass": wine_glass, "teapot": teapot, "pizza_cutter": pizza_cutter, "rolling_pin": rolling_pin}
