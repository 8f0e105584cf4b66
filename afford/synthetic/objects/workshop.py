"""Tools that strike, turn, bore, heat and spread: hammer, axe, screwdriver, drill, soldering iron, trowel. Handle towards -y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.handles import grip, knob_grip
from afford.synthetic.objects.solids import Solid, bar, block, capped, curve, laid, loft, sheet, swept, turned

ALONG_X = (0.0, 90.0, 0.0)
"""Turns what stands along z so that it lies along +x."""


def hammer(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A claw hammer on its side: face towards +x, claw towards -x."""
    long, radius = rng.uniform(0.22, 0.32), rng.uniform(0.012, 0.0165)
    eye, disk = rng.uniform(0.024, 0.032), rng.uniform(0.0115, 0.0175)
    hold = grip(rng, long, radius, 0.85 * radius)
    neck = rng.uniform(0.010, 0.022)
    poll = turned([(0, 0), (0.72 * disk, 0), (0.72 * disk, neck), (disk, neck + 0.005), (disk, neck + 0.020),
                   (0.9 * disk, neck + 0.023), (0, neck + 0.024)], 36)  # fmt: skip
    face = poll.rotate(ALONG_X).translate((0.4 * eye, eye / 2 - 0.004, 0))
    cheek = block((eye, eye * 1.05, eye), (0, eye / 2 - 0.004, 0), 0.003)
    reach, bend = rng.uniform(0.045, 0.065), rng.uniform(0.018, 0.032)
    prongs = [_prong(side, reach, bend, eye).translate((-0.3 * eye, eye / 2 - 0.004, 0)) for side in (-1, 1)]
    return Solid("handle", hold), Solid("head", cheek), Solid("face", face), Solid("claw", prongs[0] + prongs[1])


def _prong(side: int, reach: float, bend: float, eye: float) -> Manifold:
    """Half of a claw: from the eye towards -x, bent towards -y, thinning out."""
    s = np.linspace(0, 1, 14)
    rings = []
    for t in s:
        z, half = side * eye * (0.15 + 0.16 * t), eye * (0.23 - 0.09 * t)
        deep = eye * (0.40 - 0.32 * t)
        x, y = -reach * t, -bend * t**1.8
        rings.append([(x, y - deep, z - half), (x, y - deep, z + half), (x, y + deep, z + half), (x, y + deep, z - half)])
    return loft(rings)


def axe(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A hatchet on its side: a bent wooden handle, a poll, and a blade that flares towards +x."""
    long, eye = rng.uniform(0.28, 0.46), rng.uniform(0.028, 0.038)
    y, envelope = capped(-long, eye + 0.006, 0.012, 28)
    s = (y + long) / long
    x = rng.uniform(0.008, 0.022) * np.sin(np.pi * s * rng.uniform(0.8, 1.3)) - 0.006
    hold = bar(y, envelope * np.interp(s, [0, 0.08, 0.3, 1], [0.020, 0.016, 0.0135, 0.0145]), 0.0105 * envelope, x=x, square=2.5)
    reach, flare = rng.uniform(0.075, 0.12), rng.uniform(1.5, 2.6)
    t = np.linspace(0, 1, 16)
    u = np.clip((t - 0.30) / 0.70, 0, 1)
    tall = eye / 2 * (1 + (flare - 1) * u**1.4)
    low = tall + eye * rng.uniform(0.0, 0.5) * u**1.6
    deep = np.interp(t, [0, 0.28, 0.45, 0.97, 1], [0.0145, 0.016, 0.012, 0.0022, 0.0004])
    at = -0.024 + (reach + 0.024) * t
    middle = eye / 2
    rings = np.stack([np.stack([at, middle + sy, deep * sz], -1) for sy, sz in ((-low, -1), (-low, 1), (tall, 1), (tall, -1))], 1)
    bit, poll = loft(rings).split_by_plane((1, 0, 0), float(-0.024 + (reach + 0.024) * rng.uniform(0.42, 0.55)))
    return Solid("handle", hold), Solid("head", poll), Solid("blade", bit)


def screwdriver(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A fluted handle, a round shaft and a flattened or pointed tip."""
    length, radius = rng.uniform(0.085, 0.12), rng.uniform(0.012, 0.018)
    shaft, thin = rng.uniform(0.06, 0.17), rng.uniform(0.0026, 0.0042)
    hold = knob_grip(rng, length, radius, int(rng.choice([0, 5, 6, 8])))
    rod = laid(turned([(0, -0.01), (thin, -0.01), (thin, shaft), (0, shaft)], 20))
    y = shaft + np.array([-0.004, -0.002, 0.006, 0.013, 0.014])
    wide = np.array([0.9, 1.08, 1.5, 1.3, 1.3]) * thin
    deep = np.array([0.9, 1.08, 0.5, 0.22, 0.2]) * thin
    point = wide * [1, 1, 0.7, 0.25, 0.1]
    tip = bar(y, wide, deep, square=3.0) if rng.random() < 0.6 else bar(y, point, point)
    return Solid("handle", hold), Solid("shaft", rod), Solid("tip", tip)


def drill(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A cordless drill standing on its battery, bit towards +y."""
    radius, long, high = rng.uniform(0.026, 0.033), rng.uniform(0.12, 0.16), rng.uniform(0.10, 0.125)
    pack = block((rng.uniform(0.060, 0.076), rng.uniform(0.085, 0.115), 0.042), (0, 0, 0.021), 0.006)
    z = np.linspace(0.036, 0.042 + high + radius * 0.6, 14)
    lean = rng.uniform(0.05, 0.2)
    stick = swept(np.stack([0 * z, lean * (z - 0.1), z], -1), np.interp(z, [0.036, 0.08, z[-1]], [0.022, 0.0175, 0.021]), 1.25,
                  (0, 1, 0))  # fmt: skip
    axis = 0.042 + high + radius
    shell = laid(turned([(0, -0.55 * long), (0.75 * radius, -0.55 * long), (radius, -0.46 * long), (radius, 0.25 * long),
                         (0.82 * radius, 0.45 * long), (0, 0.45 * long)])).translate((0, 0, axis))  # fmt: skip
    jaw = laid(turned([(0, 0), (0.021, 0), (0.021, 0.018), (0.0185, 0.021), (0.0185, 0.030), (0.009, 0.044), (0, 0.044)], 36))
    bore, deep = rng.uniform(0.0022, 0.0045), rng.uniform(0.045, 0.10)
    bit = laid(turned([(0, 0.03), (bore, 0.03), (bore, 0.04 + deep), (0.0004, 0.046 + deep), (0, 0.046 + deep)], 16))
    high = axis - radius
    hang = np.array([(0.015, 0.003), (0.033, -0.008), (0.028, -0.034), (0.012, -0.042)]) + [lean * (high - 0.12), high]
    pull = swept(curve(np.c_[np.zeros(4), hang], 12), 0.0068, up=(1, 0, 0), sides=14)
    front = (0, 0.45 * long - 0.003, axis)
    return (Solid("battery", pack), Solid("handle", stick), Solid("body", shell), Solid("trigger", pull),
            Solid("chuck", jaw.translate(front)), Solid("bit", bit.translate(front)))  # fmt: skip


def soldering_iron(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A pen-like handle with a cord, a collar that keeps the fingers back, a thin barrel and a conical tip."""
    length, radius = rng.uniform(0.10, 0.13), rng.uniform(0.0095, 0.0135)
    y, envelope = capped(-length, 0.004, 0.010)
    s = (y + length) / length
    body = radius * envelope * np.interp(s, [0, 0.25, 0.62, 0.9, 1.1], [0.78, 0.86, 0.92, 1.12, 0.9])
    disk = rng.uniform(1.4, 2.0) * radius
    collar = laid(turned([(0, -0.003), (0.8 * disk, -0.003), (disk, 0.0), (disk, 0.002), (0.8 * radius, 0.007), (0, 0.007)], 36))
    barrel, thin = rng.uniform(0.055, 0.085), rng.uniform(0.0035, 0.0052)
    rod = laid(turned([(0, 0.002), (thin, 0.002), (thin, barrel), (0, barrel)], 24))
    point = rng.uniform(0.018, 0.034)
    cone = np.array([(0, -0.004), (1.15, -0.004), (1.15, 0.004), (0.75, 0.007), (0.7, 0.4 * point), (0.2, point), (0, point)])
    tip = laid(turned(cone * [thin, 1] + [0, barrel], 24))
    side = rng.choice([-1.0, 1.0])
    cord = swept(curve([(0, -length + 0.008, 0), (0, -length - 0.012, 0), (side * 0.010, -length - 0.040, -0.002),
                        (side * 0.028, -length - 0.055, -0.003)], 18), 0.0032, sides=12)  # fmt: skip
    hold = bar(y, body, body)
    return Solid("cord", cord), Solid("handle", hold), Solid("guard", collar), Solid("shaft", rod), Solid("tip", tip)


def trowel(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A pointing trowel: a leaf-shaped blade below a cranked neck, and a handle."""
    long, wide, thick = rng.uniform(0.11, 0.18), rng.uniform(0.040, 0.065), 0.0022
    shoulder = rng.uniform(0.10, 0.35)
    s = np.linspace(0, 1, 24)
    heel, leaf = np.sqrt(np.clip(s / shoulder, 0.02, 1)), np.clip((1 - s) / (1 - shoulder), 0, 1) ** rng.uniform(0.6, 1.0)
    half = wide * np.minimum(heel, leaf)
    y = 0.05 + long * s
    outline = np.concatenate([np.stack([half, y], -1), np.stack([-half[-2::-1], y[-2::-1]], -1)])
    plate = sheet(outline, thick)
    rise = rng.uniform(0.022, 0.04)
    neck = swept(curve([(0, -0.012, rise), (0, 0.012, rise), (0, 0.032, 0.5 * rise), (0, 0.060, 0.003), (0, 0.085, 0.001)], 20),
                 np.linspace(0.0052, 0.0042, 20), up=(1, 0, 0), sides=16)  # fmt: skip
    hold = knob_grip(rng, rng.uniform(0.09, 0.12), rng.uniform(0.0125, 0.0165)).translate((0, 0, rise))
    return Solid("handle", hold), Solid("neck", neck), Solid("blade", plate)


BUILDERS = {"hammer": hammer, "axe": axe, "screwdriver": screwdriver, "drill": drill, "soldering_iron": soldering_iron,
            "trowel": trowel}  # fmt: skip
