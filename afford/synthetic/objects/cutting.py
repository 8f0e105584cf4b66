"""Cutting tools: knife, cleaver, scissors, saw, chisel, razor. They lie on their side, handle towards -y, edge towards +x."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import (
    OVERLAP_M,
    Solid,
    bar,
    bar_grip,
    blade,
    block,
    capped,
    curve,
    hoop,
    knob_grip,
    lay_along_y,
    revolve,
    sheet,
    sweep,
)


def knife(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A kitchen knife, from paring to carving knife: pointed blade, bolster, handle."""
    length, height, thick = rng.uniform(0.09, 0.24), rng.uniform(0.020, 0.046), rng.uniform(0.0018, 0.003)
    s = np.linspace(0, 1, 26)
    belly, drop = rng.uniform(1.8, 4.5), rng.uniform(0.1, 0.75)
    spine = -height / 2 + drop * height * s ** rng.uniform(2, 5)
    edge = spine[-1] + 0.0008 + (height / 2 - spine[-1]) * (1 - s**belly) ** 0.8
    flat = blade(-0.002 + length * s, spine, edge, thick)
    wide, deep = min(rng.uniform(0.011, 0.015), 0.55 * height), rng.uniform(0.007, 0.010)
    hold = bar_grip(rng, rng.uniform(0.095, 0.125), wide, deep).translate((-height / 2 + wide + 0.001, -0.008, 0))
    at, collar = -height / 2 + wide, 1.08 * wide
    tall = np.array([0.98, 1.06, 0.95, 0.32]) * deep
    cuff = bar([-0.012, -0.011, 0.0, 0.007], np.array([0.92, 1, 1, 0.8]) * collar, tall, x=at, square=3.5)
    return Solid("handle", hold), Solid("bolster", cuff), Solid("blade", flat)


def cleaver(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A tall rectangular blade with a hole in its far corner and a short handle at its back."""
    length, height, thick = rng.uniform(0.15, 0.20), rng.uniform(0.075, 0.11), rng.uniform(0.003, 0.0045)
    s = np.linspace(0, 1, 24)
    bulge = 1 - rng.uniform(0.02, 0.10) * (2 * s - 1) ** 2
    spine = np.full_like(s, -height / 2) + rng.uniform(0, 0.06) * height * s**3
    flat = blade(length * s, spine, -height / 2 + height * bulge, thick, ground=0.7)
    hole = Manifold.cylinder(0.02, rng.uniform(0.006, 0.009), circular_segments=24, center=True)
    flat = flat - hole.translate((-height / 2 + 0.018, length - 0.018, 0))
    wide, deep = rng.uniform(0.013, 0.016), rng.uniform(0.009, 0.012)
    hold = bar_grip(rng, rng.uniform(0.10, 0.13), wide, deep).translate((-height / 2 + wide + 0.004, 0.002, 0))
    return Solid("handle", hold), Solid("blade", flat)


def scissors(rng: np.random.Generator) -> tuple[Solid, ...]:
    """Two blades that cross at a pivot, slightly open, with a loop at the end of each."""
    length, wide = rng.uniform(0.06, 0.12), rng.uniform(0.013, 0.019)
    opened, reach = rng.uniform(4, 13), rng.uniform(0.035, 0.05)
    ratio, pin = rng.uniform(1.0, 1.7), rng.uniform(0.0035, 0.005)
    under = _scissor_half(-1, length, wide, reach, 1.0, opened)
    over = _scissor_half(1, length, wide, reach, ratio, opened + 1)
    return *under, *over, Solid("pivot", revolve([(0, -0.0044), (pin, -0.0044), (pin, 0.0046), (0, 0.0046)], 26))


def _scissor_half(side: int, length: float, wide: float, reach: float, ratio: float, opened: float) -> tuple[Solid, ...]:
    """One blade above (+1) or below (-1) the other, its edge towards `side` and its loop on the other side of the axis."""
    s = np.linspace(0, 1, 20)
    edge, spine = side * 0.30 * wide * np.ones_like(s), -side * 0.70 * wide * (1 - s**2.2) + side * 0.0012
    steel = blade(-0.012 + (length + 0.012) * s, spine, edge + side * 0.001, 0.0024).translate((0, 0, side * 0.0011))
    radius, thick = 0.0125, 0.0042
    middle = np.array([-side * 0.024, -reach - radius * ratio - 0.012, 0])
    loop = hoop(radius, radius * ratio, thick, 0.9).translate(tuple(middle))
    arm = sweep(curve([(0, 0, 0), (-side * 0.007, -0.45 * reach, 0), (-side * 0.020, -reach - 0.010, 0)], 12),
                np.linspace(0.0062, 0.0048, 12), 0.7, sides=16)  # fmt: skip
    hold = (loop + arm).translate((0, 0, side * 0.0012))
    return tuple(Solid(part, shape.rotate((0, 0, side * opened))) for part, shape in (("handle", hold), ("blade", steel)))


def saw(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A hand saw: a long tapering sheet with teeth, and a closed wooden handle."""
    long, heel, toe, teeth = rng.uniform(0.24, 0.40), rng.uniform(0.07, 0.11), rng.uniform(0.03, 0.05), int(rng.integers(28, 48))
    y = np.linspace(0.004, long, 2 * teeth + 1)
    tooth = np.where(np.arange(len(y)) % 2, rng.uniform(0.003, 0.0055), 0.0)
    line = tooth - 0.004 * (2 * y / long - 1) ** 2
    steel = sheet([(-heel, 0.0), (-toe, long), *zip(line[::-1], y[::-1], strict=True)], 0.0016)
    back = rng.uniform(0.095, 0.115)
    outer = np.array([(-heel - 0.006, 0.030), (-0.75 * heel, 0.050), (0.002, 0.018), (0.014, -0.35 * back), (0.006, -back),
                      (-0.55 * heel, -back - 0.010), (-heel - 0.012, -back + 0.010)])  # fmt: skip
    hole = np.array([(-0.016, -0.024), (-0.018, -back + 0.022), (-0.60 * heel, -back + 0.016), (-heel + 0.010, -0.5 * back),
                     (-heel + 0.014, -0.024)])  # fmt: skip
    wood = sheet(outer, rng.uniform(0.019, 0.024), (hole,), 0.006)
    return Solid("handle", wood), Solid("blade", steel)


def chisel(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A turned handle, a ferrule, and a flat blade ground at its end."""
    long, wide, thick = rng.uniform(0.09, 0.15), rng.uniform(0.006, 0.019), rng.uniform(0.0022, 0.0036)
    radius, length = rng.uniform(0.013, 0.017), rng.uniform(0.10, 0.13)
    line = np.array([(0, -0.010), (0.70, -0.010), (0.80, -0.008), (0.78, 0.008), (0.4, 0.012), (0, 0.012)])
    ring = lay_along_y(revolve(line * [radius, 1], 32))
    y = np.array([0.006, 0.020, 0.035, long * 0.6, long - 3.2 * thick, long])
    half = wide * np.array([0.45, 0.5, 1.0, 1.0, 1.0, 1.0]) if wide > 0.009 else np.full(6, wide)
    t = thick * np.array([1.3, 1.3, 1.0, 0.9, 0.85, 0.08])
    steel = bar(y, half, t, z=np.array([0, 0, 0, 0, 0, -0.75 * thick]), square=8.0)
    return Solid("handle", knob_grip(rng, length, radius)), Solid("ferrule", ring), Solid("blade", steel)


def razor(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A safety razor: a round handle, and a head across its end with the blade exposed on both sides."""
    length, radius = rng.uniform(0.075, 0.10), rng.uniform(0.0048, 0.0065)
    y, envelope = capped(-length, 0.0, radius)
    ribs = 1 + 0.06 * np.sign(np.sin(y * 2 * np.pi / 0.008)) * (y < -0.02)
    neck = 1 - 0.35 * np.clip((y + 0.016) / 0.016, 0, 1)
    hold = bar(y, radius * envelope * ribs * neck, radius * envelope * ribs * neck)
    half, across = rng.uniform(0.020, 0.023), rng.uniform(0.0085, 0.0105)
    x, ends = capped(-half, half, 0.004, 14)
    cap = bar(x, across * 0.92 * ends, 0.0036 * ends, square=2.6, sides=28).rotate((0, 0, 90))
    guard = bar(x, across * ends, 0.0018 * ends, square=2.4, sides=28).rotate((0, 0, 90)).translate((0, 0, -0.0052))
    stem = Manifold.cylinder(0.008, 0.0035, circular_segments=20).translate((0, 0, -0.008))
    edge = block((2 * half + 0.003, 2 * across + 0.007, 0.0012), (0, 0, -0.0036), 0.0003)
    tilt = rng.uniform(60, 80)
    head = [(shape.rotate((-tilt, 0, 0)).translate((0, OVERLAP_M + 0.001, 0))) for shape in (cap + guard + stem, edge)]
    return Solid("handle", hold), Solid("head", head[0]), Solid("blade", head[1])


BUILDERS = {"knife": knife, "cleaver": cleaver, "scissors": scissors, "saw": saw, "chisel": chisel, "razor": razor}
