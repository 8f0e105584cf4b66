"""Tools of shed and garage: pliers, wrench, shovel, paint roller. They lie flat, handle towards -y."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from afford.synthetic.objects.handles import dee, grip, knob_grip, ring, tee
from afford.synthetic.objects.solids import Solid, bar, capped, curve, plate, sheet, swept, turned, wire


def pliers(rng: np.random.Generator) -> tuple[Solid, ...]:
    """Pliers, opened a little: needle-nosed, blunt or broad; jaws straight on or turned aside."""
    long, wide = rng.uniform(0.025, 0.075), rng.uniform(0.0065, 0.0145)
    sharp, thick = rng.uniform(0.15, 0.9), rng.uniform(0.0042, 0.0070)
    boss, aside = rng.uniform(0.011, 0.015), float(rng.choice([0, 0, 0, 0, -30, -45]))
    reach, spread = rng.uniform(0.085, 0.135), rng.uniform(0.017, 0.027)
    girth, flat, opened = rng.uniform(0.0062, 0.0090), rng.uniform(0.75, 1.25), rng.uniform(1.0, 9.0)
    jaws = [_jaw(side, long, wide, sharp, thick).rotate((0, 0, -side * opened)) for side in (-1, 1)]
    middle = Manifold.cylinder(2 * thick, boss, circular_segments=40, center=True)
    pin = turned([(0, -thick - 0.0022), (0.62 * boss, -thick - 0.0022), (0.62 * boss, thick + 0.0025), (0, thick + 0.0025)], 30)
    holds = [_arm(side, reach, spread, girth, flat, boss).rotate((0, 0, -side * 0.4 * opened)) for side in (-1, 1)]
    head = (jaws[0] + jaws[1] + middle).rotate((0, 0, aside))
    return Solid("handle", holds[0] + holds[1]), Solid("pivot", pin), Solid("jaw", head)


def _jaw(side: int, long: float, wide: float, sharp: float, thick: float) -> Manifold:
    """Half of the jaws along +y, its inner face just off x = 0; `sharp` is what is left of the width at its end."""
    y = np.array([-0.006, 0.0, 0.25 * long, 0.9 * long, long]) + 0.004
    half = wide / 2 * np.array([0.8, 1.0, 1.0, sharp, 0.75 * sharp])
    deep = thick * np.array([0.9, 0.95, 0.95, 0.5 + 0.4 * sharp, 0.4 + 0.4 * sharp])
    return bar(y, half, deep, x=side * (half + 0.0004), square=4.0)


def _arm(side: int, reach: float, spread: float, girth: float, flat: float, boss: float) -> Manifold:
    """A handle from the pivot towards -y, bowed outwards."""
    path = curve([(-side * 0.3 * boss, -0.2 * boss, 0), (-side * 0.8 * boss, -1.3 * boss, 0), (-side * spread, -0.5 * reach, 0),
                  (-side * 0.95 * spread, -0.8 * reach, 0), (-side * 0.75 * spread, -reach, 0)], 30)  # fmt: skip
    s = np.linspace(0, 1, 30)
    return swept(path, girth * np.interp(s, [0, 0.2, 0.35, 0.93, 0.98, 1], [0.6, 0.7, 1.0, 0.95, 0.75, 0.35]), flat, sides=18)


def wrench(rng: np.random.Generator) -> tuple[Solid, ...]:
    """An open, a ring or an adjustable wrench, its handle straight, with a hole or a ring at its end."""
    long = rng.uniform(0.10, 0.26)
    radius, thick = rng.uniform(0.11, 0.17) * long, rng.uniform(0.022, 0.042) * long
    make = (_open_end, _ring_end, _adjustable)[int(rng.integers(3))]
    half = rng.uniform(0.34, 0.58) * radius
    y, envelope = capped(-long, -0.55 * radius, half, 24)
    waist = 1 - rng.uniform(0, 0.25) * np.sin(np.pi * np.linspace(0, 1, 24))
    hold = bar(y, half * envelope * waist, 0.42 * thick * rng.uniform(0.8, 1.05), square=rng.uniform(2.5, 7.0))
    if rng.random() < 0.6:
        hole = Manifold.cylinder(1.0, 0.5 * half, circular_segments=24, center=True)
        hold = hold - hole.translate((0, 1.3 * half - long, 0))
    return Solid("handle", hold), Solid("jaw", make(rng, radius, thick).rotate((float(rng.choice([0, 0, 8, 14])), 0, 0)))


def _open_end(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A round head with a slot that is turned aside."""
    a = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    outline = np.stack([radius * np.cos(a), 1.08 * radius * np.sin(a)], -1)
    half, deep = rng.uniform(0.42, 0.56) * radius, rng.uniform(0.0, 0.35) * radius
    slot = np.array([(-half, 2 * radius), (-half, deep), (0, deep - 0.45 * half), (half, deep), (half, 2 * radius)])
    return sheet(outline, thick, (slot,)).rotate((0, 0, float(rng.choice([-1, 1])) * rng.uniform(0, 25)))


def _ring_end(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A closed ring around a nut of six or twelve corners."""
    corners = int(rng.choice([6, 12]))
    a = np.linspace(0, 2 * np.pi, 2 * corners, endpoint=False) if corners == 12 else np.linspace(0, 2 * np.pi, 6, endpoint=False)
    r = rng.uniform(0.58, 0.70) * radius * (np.where(np.arange(len(a)) % 2, 0.9, 1.0) if corners == 12 else 1.0)
    nut = CrossSection([np.stack([r * np.cos(a), r * np.sin(a)], -1)])
    deep = rng.uniform(1.1, 1.6) * thick
    return Manifold.extrude(CrossSection.circle(radius, 48) - nut, deep).translate((0, 0, -deep / 2))


def _adjustable(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A fixed jaw, one that slides across, and the worm that moves it."""
    gap, tall = rng.uniform(0.25, 0.8) * radius, rng.uniform(0.9, 1.3) * radius
    fixed = np.array([(-0.60, -0.75), (0.50, -0.75), (0.95, -0.15), (0.95, 0.30), (-0.45, 0.30), (-0.42, 1.0), (-0.72, 1.0),
                      (-1.0, 0.4), (-0.95, -0.1)]) * [radius, 1.0] * [1.0, tall]  # fmt: skip
    left = -0.45 * radius + gap
    slide = np.array([(left, 0.0), (left + 0.55 * radius, 0.0), (left + 0.5 * radius, 0.55 * tall), (left + 0.2 * radius, tall),
                      (left, tall)])  # fmt: skip
    worm = Manifold.cylinder(0.6 * radius, 0.62 * thick, circular_segments=24, center=True).rotate((0, 90, 0))
    return sheet(fixed, thick, (), 0.0012) + sheet(slide, 0.8 * thick, (), 0.0012) + worm.translate((0.1 * radius, -0.3 * tall, 0))


def shovel(rng: np.random.Generator) -> tuple[Solid, ...]:
    """From a camping spade to a garden shovel: a dished blade, square or pointed, and a knob, a T or a D at the other end."""
    size, shaft, radius = rng.uniform(0.5, 0.95), rng.uniform(0.28, 0.70), rng.uniform(0.013, 0.018)
    long, half, dish = rng.uniform(0.19, 0.31), rng.uniform(0.075, 0.125), rng.uniform(0.06, 0.30)
    v, u = np.linspace(0, 1, 16)[:, None], np.linspace(-1, 1, 15)[None]
    point, heel = float(rng.choice([0.0, rng.uniform(0.05, 0.45)])), rng.uniform(0.0, 0.12)
    wide = half * np.interp(v, [0, 0.2, 1], [rng.uniform(0.8, 1), 1, rng.uniform(0.75, 1)])
    y = 0.05 + long * (v * (1 - point * u**2) - heel * u**2 * (1 - v))
    z = dish * half * (u**2 * (1 - 0.7 * v) + 0.35 * np.sin(np.pi * v))
    blade = plate(np.stack(np.broadcast_arrays(wide * u, y, z), -1), 0.0042)
    socket = swept(curve([(0, -0.05, 0.022), (0, 0.02, 0.018), (0, 0.05 + 0.4 * long, 0.3 * dish * half)], 20),
                   np.interp(np.linspace(0, 1, 20), [0, 0.4, 1], [1.25 * radius, 1.15 * radius, 0.006]), sides=20)  # fmt: skip
    y = np.linspace(-shaft, -0.03, 16)
    bend = rng.uniform(0.0, 0.05) * np.sin(np.pi * (y + shaft) / shaft)
    stick = swept(np.stack([0 * y, y, 0.0215 + bend], -1), radius)
    kind, girth = int(rng.integers(3)), rng.uniform(0.95, 1.2) * radius
    hold = (knob_grip(rng, rng.uniform(0.10, 0.14), 1.45 * radius) if kind == 0 else
            tee(rng, rng.uniform(0.11, 0.16), girth) if kind == 1 else
            dee(rng, rng.uniform(0.11, 0.15), rng.uniform(0.10, 0.14), girth))  # fmt: skip
    hold = hold.translate((0, 0.004 - shaft, 0.0215))
    parts = {"handle": hold, "shaft": stick, "blade": blade + socket}
    return tuple(Solid(part, shape.scale((size,) * 3)) for part, shape in parts.items())


def paint_roller(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A roller on a bent wire: narrow or broad, thick or thin, its handle smooth, waisted or ending in a ring."""
    half, radius = rng.uniform(0.04, 0.125), rng.uniform(0.013, 0.032)
    side, reach, thick = float(rng.choice([-1, 1])), rng.uniform(0.075, 0.17), rng.uniform(0.0038, 0.0052)
    long, girth = rng.uniform(0.10, 0.14), rng.uniform(0.011, 0.016)
    hold = knob_grip(rng, long, girth) if rng.random() < 0.4 else grip(rng, long, girth, rng.uniform(0.8, 1.0) * girth)
    if rng.random() < 0.3:
        hold = hold + ring(rng, 0.016, 0.0055).translate((0, 0.006 - long, 0))
    out, up = side * (half + rng.uniform(0.016, 0.026)), rng.uniform(0.2, 0.5) * reach
    rod = wire([(0, -0.02, 0), (0, up, 0), (out, 0.62 * reach, 0), (out, reach, 0), (side * 0.5 * half, reach, 0)], thick, 0.012)
    r, h = radius * np.array([0, 0.45, 0.5, 0.92, 1.0, 1.0, 0.92, 0.5, 0.45, 0]), half * np.array(
        [-0.94, -0.94, -1, -1, -0.965, 0.965, 1, 1, 0.94, 0.94])  # fmt: skip
    nap = turned(np.stack([r, h], -1)).rotate((0, 90, 0)).translate((0, reach, 0))
    return Solid("handle", hold), Solid("shaft", rod), Solid("roller", nap)


BUILDERS = {"pliers": pliers, "wrench": wrench, "shovel": shovel, "paint_roller": paint_roller}
