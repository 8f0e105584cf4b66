"""Tools for striking, turning, drilling, heating, spreading and digging. They lie, handle towards -y, except the drill."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from afford.synthetic.objects.solid_shapes import (
    Solid,
    bar,
    bar_grip,
    block,
    capped,
    curve,
    d_grip,
    knob_grip,
    lay_along_y,
    loft,
    plate,
    revolve,
    ring_grip,
    sheet,
    sweep,
    t_grip,
    wire,
)

ALONG_X = (0.0, 90.0, 0.0)
"""Rotation of a shape along z so that it lies along +x."""


def hammer(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A claw hammer on its side: face towards +x, claw towards -x."""
    long, radius = rng.uniform(0.22, 0.32), rng.uniform(0.012, 0.0165)
    eye, disk = rng.uniform(0.024, 0.032), rng.uniform(0.0115, 0.0175)
    hold = bar_grip(rng, long, radius, 0.85 * radius)
    neck = rng.uniform(0.010, 0.022)
    poll = revolve([(0, 0), (0.72 * disk, 0), (0.72 * disk, neck), (disk, neck + 0.005), (disk, neck + 0.020),
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
    rod = lay_along_y(revolve([(0, -0.01), (thin, -0.01), (thin, shaft), (0, shaft)], 20))
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
    stick = sweep(np.stack([0 * z, lean * (z - 0.1), z], -1), np.interp(z, [0.036, 0.08, z[-1]], [0.022, 0.0175, 0.021]), 1.25,
                  (0, 1, 0))  # fmt: skip
    axis = 0.042 + high + radius
    shell = lay_along_y(revolve([(0, -0.55 * long), (0.75 * radius, -0.55 * long), (radius, -0.46 * long), (radius, 0.25 * long),
                         (0.82 * radius, 0.45 * long), (0, 0.45 * long)])).translate((0, 0, axis))  # fmt: skip
    line = [(0, 0), (0.021, 0), (0.021, 0.018), (0.0185, 0.021), (0.0185, 0.030), (0.009, 0.044), (0, 0.044)]
    jaw = lay_along_y(revolve(line, 36))
    bore, deep = rng.uniform(0.0022, 0.0045), rng.uniform(0.045, 0.10)
    bit = lay_along_y(revolve([(0, 0.03), (bore, 0.03), (bore, 0.04 + deep), (0.0004, 0.046 + deep), (0, 0.046 + deep)], 16))
    high = axis - radius
    hang = np.array([(0.015, 0.003), (0.033, -0.008), (0.028, -0.034), (0.012, -0.042)]) + [lean * (high - 0.12), high]
    pull = sweep(curve(np.c_[np.zeros(4), hang], 12), 0.0068, up=(1, 0, 0), sides=14)
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
    line = [(0, -0.003), (0.8 * disk, -0.003), (disk, 0.0), (disk, 0.002), (0.8 * radius, 0.007), (0, 0.007)]
    collar = lay_along_y(revolve(line, 36))
    barrel, thin = rng.uniform(0.055, 0.085), rng.uniform(0.0035, 0.0052)
    rod = lay_along_y(revolve([(0, 0.002), (thin, 0.002), (thin, barrel), (0, barrel)], 24))
    point = rng.uniform(0.018, 0.034)
    cone = np.array([(0, -0.004), (1.15, -0.004), (1.15, 0.004), (0.75, 0.007), (0.7, 0.4 * point), (0.2, point), (0, point)])
    tip = lay_along_y(revolve(cone * [thin, 1] + [0, barrel], 24))
    side = rng.choice([-1.0, 1.0])
    cord = sweep(curve([(0, -length + 0.008, 0), (0, -length - 0.012, 0), (side * 0.010, -length - 0.040, -0.002),
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
    neck = sweep(curve([(0, -0.012, rise), (0, 0.012, rise), (0, 0.032, 0.5 * rise), (0, 0.060, 0.003), (0, 0.085, 0.001)], 20),
                 np.linspace(0.0052, 0.0042, 20), up=(1, 0, 0), sides=16)  # fmt: skip
    hold = knob_grip(rng, rng.uniform(0.09, 0.12), rng.uniform(0.0125, 0.0165)).translate((0, 0, rise))
    return Solid("handle", hold), Solid("neck", neck), Solid("blade", plate)


def pliers(rng: np.random.Generator) -> tuple[Solid, ...]:
    """Pliers, slightly open: needle-nosed, blunt or broad, with straight or angled jaws."""
    long, wide = rng.uniform(0.025, 0.075), rng.uniform(0.0065, 0.0145)
    sharp, thick = rng.uniform(0.15, 0.9), rng.uniform(0.0042, 0.0070)
    boss, aside = rng.uniform(0.011, 0.015), float(rng.choice([0, 0, 0, 0, -30, -45]))
    reach, spread = rng.uniform(0.085, 0.135), rng.uniform(0.017, 0.027)
    girth, flat, opened = rng.uniform(0.0062, 0.0090), rng.uniform(0.75, 1.25), rng.uniform(1.0, 9.0)
    jaws = [_plier_jaw(side, long, wide, sharp, thick).rotate((0, 0, -side * opened)) for side in (-1, 1)]
    middle = Manifold.cylinder(2 * thick, boss, circular_segments=40, center=True)
    pin = revolve([(0, -thick - 0.0022), (0.62 * boss, -thick - 0.0022), (0.62 * boss, thick + 0.0025), (0, thick + 0.0025)], 30)
    holds = [_arm(side, reach, spread, girth, flat, boss).rotate((0, 0, -side * 0.4 * opened)) for side in (-1, 1)]
    head = (jaws[0] + jaws[1] + middle).rotate((0, 0, aside))
    return Solid("handle", holds[0] + holds[1]), Solid("pivot", pin), Solid("jaw", head)


def _plier_jaw(side: int, long: float, wide: float, sharp: float, thick: float) -> Manifold:
    """Half of the jaws along +y, its inner face just off x = 0; `sharp` is the remaining share of the width at its end."""
    y = np.array([-0.006, 0.0, 0.25 * long, 0.9 * long, long]) + 0.004
    half = wide / 2 * np.array([0.8, 1.0, 1.0, sharp, 0.75 * sharp])
    deep = thick * np.array([0.9, 0.95, 0.95, 0.5 + 0.4 * sharp, 0.4 + 0.4 * sharp])
    return bar(y, half, deep, x=side * (half + 0.0004), square=4.0)


def _arm(side: int, reach: float, spread: float, girth: float, flat: float, boss: float) -> Manifold:
    """A handle from the pivot towards -y, bowed outwards."""
    path = curve([(-side * 0.3 * boss, -0.2 * boss, 0), (-side * 0.8 * boss, -1.3 * boss, 0), (-side * spread, -0.5 * reach, 0),
                  (-side * 0.95 * spread, -0.8 * reach, 0), (-side * 0.75 * spread, -reach, 0)], 30)  # fmt: skip
    s = np.linspace(0, 1, 30)
    return sweep(path, girth * np.interp(s, [0, 0.2, 0.35, 0.93, 0.98, 1], [0.6, 0.7, 1.0, 0.95, 0.75, 0.35]), flat, sides=18)


def wrench(rng: np.random.Generator) -> tuple[Solid, ...]:
    """An open-end, ring or adjustable wrench with a straight handle, and a hole or a ring at its end."""
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
    """A round head with an angled slot."""
    a = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    outline = np.stack([radius * np.cos(a), 1.08 * radius * np.sin(a)], -1)
    half, deep = rng.uniform(0.42, 0.56) * radius, rng.uniform(0.0, 0.35) * radius
    slot = np.array([(-half, 2 * radius), (-half, deep), (0, deep - 0.45 * half), (half, deep), (half, 2 * radius)])
    return sheet(outline, thick, (slot,)).rotate((0, 0, float(rng.choice([-1, 1])) * rng.uniform(0, 25)))


def _ring_end(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A closed ring around a nut with six or twelve corners."""
    corners = int(rng.choice([6, 12]))
    a = np.linspace(0, 2 * np.pi, 2 * corners, endpoint=False) if corners == 12 else np.linspace(0, 2 * np.pi, 6, endpoint=False)
    r = rng.uniform(0.58, 0.70) * radius * (np.where(np.arange(len(a)) % 2, 0.9, 1.0) if corners == 12 else 1.0)
    nut = CrossSection([np.stack([r * np.cos(a), r * np.sin(a)], -1)])
    deep = rng.uniform(1.1, 1.6) * thick
    return Manifold.extrude(CrossSection.circle(radius, 48) - nut, deep).translate((0, 0, -deep / 2))


def _adjustable(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A fixed jaw, a sliding jaw, and the worm that moves it."""
    gap, tall = rng.uniform(0.25, 0.8) * radius, rng.uniform(0.9, 1.3) * radius
    fixed = np.array([(-0.60, -0.75), (0.50, -0.75), (0.95, -0.15), (0.95, 0.30), (-0.45, 0.30), (-0.42, 1.0), (-0.72, 1.0),
                      (-1.0, 0.4), (-0.95, -0.1)]) * [radius, 1.0] * [1.0, tall]  # fmt: skip
    left = -0.45 * radius + gap
    slide = np.array([(left, 0.0), (left + 0.55 * radius, 0.0), (left + 0.5 * radius, 0.55 * tall), (left + 0.2 * radius, tall),
                      (left, tall)])  # fmt: skip
    worm = Manifold.cylinder(0.6 * radius, 0.62 * thick, circular_segments=24, center=True).rotate((0, 90, 0))
    return sheet(fixed, thick, (), 0.0012) + sheet(slide, 0.8 * thick, (), 0.0012) + worm.translate((0.1 * radius, -0.3 * tall, 0))


def shovel(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A shovel, from camping spade to garden shovel: a dished blade, square or pointed, and a knob, T or D handle."""
    size, shaft, radius = rng.uniform(0.5, 0.95), rng.uniform(0.28, 0.70), rng.uniform(0.013, 0.018)
    long, half, dish = rng.uniform(0.19, 0.31), rng.uniform(0.075, 0.125), rng.uniform(0.06, 0.30)
    v, u = np.linspace(0, 1, 16)[:, None], np.linspace(-1, 1, 15)[None]
    point, heel = float(rng.choice([0.0, rng.uniform(0.05, 0.45)])), rng.uniform(0.0, 0.12)
    wide = half * np.interp(v, [0, 0.2, 1], [rng.uniform(0.8, 1), 1, rng.uniform(0.75, 1)])
    y = 0.05 + long * (v * (1 - point * u**2) - heel * u**2 * (1 - v))
    z = dish * half * (u**2 * (1 - 0.7 * v) + 0.35 * np.sin(np.pi * v))
    blade = plate(np.stack(np.broadcast_arrays(wide * u, y, z), -1), 0.0042)
    socket = sweep(curve([(0, -0.05, 0.022), (0, 0.02, 0.018), (0, 0.05 + 0.4 * long, 0.3 * dish * half)], 20),
                   np.interp(np.linspace(0, 1, 20), [0, 0.4, 1], [1.25 * radius, 1.15 * radius, 0.006]), sides=20)  # fmt: skip
    y = np.linspace(-shaft, -0.03, 16)
    bend = rng.uniform(0.0, 0.05) * np.sin(np.pi * (y + shaft) / shaft)
    stick = sweep(np.stack([0 * y, y, 0.0215 + bend], -1), radius)
    kind, girth = int(rng.integers(3)), rng.uniform(0.95, 1.2) * radius
    hold = (knob_grip(rng, rng.uniform(0.10, 0.14), 1.45 * radius) if kind == 0 else
            t_grip(rng, rng.uniform(0.11, 0.16), girth) if kind == 1 else
            d_grip(rng, rng.uniform(0.11, 0.15), rng.uniform(0.10, 0.14), girth))  # fmt: skip
    hold = hold.translate((0, 0.004 - shaft, 0.0215))
    parts = {"handle": hold, "shaft": stick, "blade": blade + socket}
    return tuple(Solid(part, shape.scale((size,) * 3)) for part, shape in parts.items())


def paint_roller(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A roller on a bent wire, narrow or broad, with a smooth, waisted or ring-ended handle."""
    half, radius = rng.uniform(0.04, 0.125), rng.uniform(0.013, 0.032)
    side, reach, thick = float(rng.choice([-1, 1])), rng.uniform(0.075, 0.17), rng.uniform(0.0038, 0.0052)
    long, girth = rng.uniform(0.10, 0.14), rng.uniform(0.011, 0.016)
    hold = knob_grip(rng, long, girth) if rng.random() < 0.4 else bar_grip(rng, long, girth, rng.uniform(0.8, 1.0) * girth)
    if rng.random() < 0.3:
        hold = hold + ring_grip(rng, 0.016, 0.0055).translate((0, 0.006 - long, 0))
    out, up = side * (half + rng.uniform(0.016, 0.026)), rng.uniform(0.2, 0.5) * reach
    rod = wire([(0, -0.02, 0), (0, up, 0), (out, 0.62 * reach, 0), (out, reach, 0), (side * 0.5 * half, reach, 0)], thick, 0.012)
    r, h = radius * np.array([0, 0.45, 0.5, 0.92, 1.0, 1.0, 0.92, 0.5, 0.45, 0]), half * np.array(
        [-0.94, -0.94, -1, -1, -0.965, 0.965, 1, 1, 0.94, 0.94])  # fmt: skip
    nap = revolve(np.stack([r, h], -1)).rotate((0, 90, 0)).translate((0, reach, 0))
    return Solid("handle", hold), Solid("shaft", rod), Solid("roller", nap)


BUILDERS = {"hammer": hammer, "axe": axe, "screwdriver": screwdriver, "drill": drill, "soldering_iron": soldering_iron,
            "trowel": trowel, "pliers": pliers, "wrench": wrench, "shovel": shovel, "paint_roller": paint_roller}  # fmt: skip
