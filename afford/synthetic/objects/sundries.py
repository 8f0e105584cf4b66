"""Small things: toothbrush and flashlight lie, handle towards -y; spray bottle and candle stand, nozzle towards +y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.handles import grip, laid_inverse, ring
from afford.synthetic.objects.household import spots
from afford.synthetic.objects.solids import Solid, bar, block, capped, curve, hoop, laid, swept, turned


def toothbrush(rng: np.random.Generator) -> tuple[Solid, ...]:
    """By hand: flat, slender or stout; electric: a thick round handle and a round head. Bristles upwards."""
    electric = rng.random() < 0.3
    long, reach = rng.uniform(0.085, 0.135), rng.uniform(0.022, 0.050)
    wide = rng.uniform(0.0115, 0.0150) if electric else rng.uniform(0.0050, 0.0095)
    deep = wide * rng.uniform(0.85, 1.0) if electric else rng.uniform(0.0042, 0.0070)
    half_y = rng.uniform(0.0078, 0.0100) if electric else rng.uniform(0.011, 0.019)
    half_x = half_y if electric else rng.uniform(0.0058, 0.0088)
    rise = rng.uniform(-0.010, 0.010)
    path = curve([(0, -0.008, 0), (0, 0.3 * reach, 0.15 * rise), (0, 0.8 * reach, rise), (0, reach + 0.5 * half_y, rise)], 20)
    girth = np.interp(np.linspace(0, 1, 20), [0, 0.18, 0.55, 1], [0.85 * min(wide, deep), 0.8 * min(wide, deep), 0.0034, 0.0034])
    y, envelope = capped(reach, reach + 2 * half_y, 0.9 * half_x, 18)
    plate = bar(y, half_x * envelope, 0.0027 * np.maximum(envelope, 0.6), z=rise, square=2.8)
    high, wave, turns = rng.uniform(0.008, 0.012), rng.uniform(0, 0.35), rng.uniform(1, 3)
    step = rng.uniform(0.0043, 0.0052)
    spread = spots(half_x - 0.0014, half_y - 0.0014, step)
    tall = [0.002 + high * (1 + wave * np.sin(turns * 2 * v / half_y)) for _, v in spread]
    tufts = [Manifold.cylinder(up, 0.0016, 0.0021, 8).translate((x, reach + half_y + v, rise + 0.0007))
             for up, (x, v) in zip(tall, spread, strict=True)]  # fmt: skip
    return (Solid("handle", grip(rng, long, wide, deep)), Solid("neck", swept(path, girth)), Solid("head", plate),
            *(Solid("bristles", tuft) for tuft in tufts))  # fmt: skip


def spray_bottle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A bottle, round, flat or square, with or without a waist; a collar, a head with a nozzle, a trigger below it."""
    half_x, h = rng.uniform(0.026, 0.042), rng.uniform(0.10, 0.19)
    half_y, narrow = half_x * rng.uniform(0.65, 1.25), rng.uniform(0.012, 0.0155)
    t = np.array([0.0, 0.02, 0.10, 0.30, 0.50, rng.uniform(0.60, 0.80), 0.93, 1.0])
    waist = 1 - rng.uniform(0, 0.22) * np.array([0, 0, 0, 0.6, 1, 0.5, 0, 0])
    share = curve(np.stack([t, np.array([0.90, 0.98, 1, 1, 1, 1, 0, 0]) * waist], -1), 30)
    x, y = (narrow + (half - narrow) * np.clip(share[:, 1], 0, None) for half in (half_x, half_y))
    flask = laid_inverse(bar(-h * share[:, 0], x, y, square=rng.uniform(2.0, 4.5), sides=40)).rotate((180, 0, 0))
    tall, over = rng.uniform(0.014, 0.024), rng.uniform(1.15, 1.4) * narrow
    collar = turned([(0, h - 0.006), (over, h - 0.006), (over, h + tall - 0.002), (0.85 * over, h + tall), (0, h + tall)], 32)
    z, back, front = h + tall + 0.010, rng.uniform(0.016, 0.034), rng.uniform(0.022, 0.040)
    y, envelope = capped(-back, front, 0.006, 16)
    s = np.linspace(0, 1, 16)
    size, tail = rng.uniform(0.0105, 0.0140), rng.uniform(0.55, 1.0)
    top = bar(y, 0.9 * size * envelope, size * envelope * np.interp(s, [0, 0.5, 1], [tail, 1, 0.85]), z=z, square=3.2)
    neck = Manifold.cylinder(0.020, 0.8 * narrow, circular_segments=28).translate((0, 0, z - 0.014))
    tip = rng.uniform(0.0080, 0.0110)
    end = bar(front + np.array([-0.003, 0.0, 0.013, 0.015]), tip * np.array([1, 1, 0.92, 0.75]), tip * np.array([1, 1, 0.92, 0.75]),
              z=z, square=float(rng.choice([2.0, 6.0])))  # fmt: skip
    hang, out = rng.uniform(0.034, 0.050), 0.75 * front
    lever = curve([(0, out - 0.004, z - 0.2 * size), (0, out + 0.003, z - size - 0.008), (0, out - 0.003, z - size - 0.6 * hang),
                   (0, out + 0.008, z - size - hang)], 20)  # fmt: skip
    pull = swept(lever, np.linspace(0.0050, 0.0072, 20), 0.65, (0, 1, 0), sides=16)
    return (Solid("body", flask), Solid("neck", collar), Solid("head", top + neck), Solid("trigger", pull), Solid("nozzle", end))


def flashlight(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A torch, slender or stout, its head flared, plain or turned upwards; the switch on its side or at its end."""
    long, radius = rng.uniform(0.07, 0.19), rng.uniform(0.010, 0.018)
    flare, deep = rng.uniform(1.15, 2.2), rng.uniform(0.028, 0.055)
    y, envelope = capped(-long, 0.006, 0.5 * radius, 60)
    grooves = 1 - 0.07 * (np.sin(y * 2 * np.pi / rng.uniform(0.007, 0.014)) > 0) * (y > -0.85 * long) * (y < -0.35 * long)
    tube = bar(y, radius * envelope * grooves, radius * envelope * grooves, square=float(rng.choice([2.0, 2.0, 3.5])))
    wide = flare * radius
    bell = turned([(0, -0.004), (1.06 * radius, -0.004), (1.06 * radius, 0.006), (wide, 0.45 * deep), (wide, deep),
                   (0.86 * wide, deep), (0.80 * wide, deep - 0.004), (0, deep - 0.004)], 48)  # fmt: skip
    a = np.linspace(0, np.pi / 2, 8)
    bulge = rng.uniform(0.001, 0.30 * wide)
    glass = np.stack([0.83 * wide * np.cos(a), deep - 0.0035 + bulge * np.sin(a)], -1)
    pane = turned([(0, deep - 0.006), (0.83 * wide, deep - 0.006), *glass[:-1], (0, glass[-1, 1])], 40)
    if rng.random() < 0.25:
        place = [shape.translate((0, -0.4 * radius, 0.6 * radius)) for shape in (bell, pane)]
    else:
        place = [laid(bell), laid(pane)]
    return Solid("body", tube), Solid("switch", _switch(rng, long, radius)), Solid("head", place[0]), Solid("lens", place[1])


def _switch(rng: np.random.Generator, long: float, radius: float) -> Manifold:
    """A button: a disc or a slide on the side that faces up, or a cap at the end."""
    kind, at = int(rng.integers(3)), -rng.uniform(0.12, 0.30) * long
    if kind == 0:
        return block((1.1 * radius, rng.uniform(1.4, 2.4) * radius, 0.5 * radius), (0, at, 0.98 * radius), 0.001)
    if kind == 1:
        return Manifold.cylinder(0.5 * radius, 0.62 * radius, 0.5 * radius, 28).translate((0, at, 0.75 * radius))
    cap = turned([(0, -0.010), (0.5 * radius, -0.009), (0.62 * radius, -0.005), (0.62 * radius, 0.006), (0, 0.006)], 28)
    return laid(cap).translate((0, 0.002 - long, 0))


def candle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A candle in a holder to carry it by: a saucer or a cup on a foot, with a ring, an ear or a stick to hold."""
    thick, tall = rng.uniform(0.0095, 0.022), rng.uniform(0.045, 0.16)
    plate, lip = thick + rng.uniform(0.022, 0.045), rng.uniform(0.006, 0.016)
    stand = float(rng.choice([0.0, rng.uniform(0.02, 0.09)]))
    dish = turned([(0, 0), (0.8 * plate, 0), (plate, lip), (plate - 0.003, lip + 0.001), (0.78 * plate, 0.0045), (0, 0.0045)], 56)
    cup, top = 1.25 * thick + 0.002, stand + 0.022
    post = turned([(0, 0.002), (cup + 0.004, 0.002), (0.75 * cup, 0.010 + 0.3 * stand), (0.75 * cup, 0.003 + 0.8 * stand),
                   (cup, 0.010 + stand), (cup, top), (0, top)], 36)  # fmt: skip
    z = np.linspace(top - 0.008, top + tall, 16)
    lean = np.interp(z, [z[0], z[-2], z[-1]], [1.0, rng.uniform(0.7, 1.0), 0.6])
    wax = turned(np.concatenate([[(0, z[0])], np.stack([thick * lean, z], -1), [(0, z[-1] - 0.001)]]), 36)
    bend = rng.uniform(-0.004, 0.004)
    end = top + tall
    wick = swept(curve([(0, 0, end - 0.006), (0, 0, end + 0.005), (0, bend, end + rng.uniform(0.017, 0.024))], 12),
                 np.linspace(0.0036, 0.0026, 12), up=(1, 0, 0), sides=12)  # fmt: skip
    return Solid("holder", dish + post), Solid("handle", _ear(rng, plate, lip)), Solid("body", wax), Solid("wick", wick)


def _ear(rng: np.random.Generator, plate: float, lip: float) -> Manifold:
    """What the holder is carried by, beyond the edge of its plate."""
    kind, radius = int(rng.integers(3)), rng.uniform(0.014, 0.021)
    if kind == 0:
        stood = hoop(radius, radius, rng.uniform(0.0036, 0.0055), rng.uniform(1.0, 1.6)).rotate((0, 90, 0))
        return stood.translate((0, -plate - radius + 0.003, lip + 0.5 * radius))
    if kind == 1:
        return ring(rng, radius, rng.uniform(0.0040, 0.0058)).translate((0, 0.001 - plate, 0.75 * lip))
    stick = grip(rng, rng.uniform(0.05, 0.09), rng.uniform(0.007, 0.011), rng.uniform(0.0045, 0.0070))
    return stick.rotate((-rng.uniform(0, 25), 0, 0)).translate((0, 0.001 - plate, 0.7 * lip + 0.001))


BUILDERS = {"toothbrush": toothbrush, "spray_bottle": spray_bottle, "flashlight": flashlight, "candle": candle}
