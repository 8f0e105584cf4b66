"""Household objects: iron, hair dryer, brushes, spatula, fork, spray bottle, flashlight, candle. Handle at -y, working end at +y.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import (
    Solid,
    bar,
    bar_grip,
    block,
    capped,
    curve,
    hoop,
    lay_along_y,
    loft,
    revolve,
    ring_grip,
    sheet,
    stand_along_z,
    sweep,
)


def iron(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A flat iron: a pointed metal plate, a body that narrows upwards, an arched handle and a cord."""
    long, wide, high = rng.uniform(0.20, 0.27), rng.uniform(0.095, 0.125), rng.uniform(0.040, 0.060)
    outline = _boat(long, wide, rng.uniform(1.6, 2.4))
    plate = loft([np.c_[outline * k, np.full(len(outline), z)] for k, z in ((0.985, 0.0), (1.0, 0.002), (1.0, 0.009))])
    levels = np.linspace(0, 1, 9)
    shrink = 0.97 - rng.uniform(0.30, 0.42) * levels**1.3
    slant = 0.10 * long * levels
    body = loft([np.c_[outline * [k, 0.45 + 0.55 * k] + [0, -d * 0.25], np.full(len(outline), 0.0075 + high * v)]
                 for k, d, v in zip(shrink, slant, levels, strict=True)])  # fmt: skip
    top = 0.0075 + high
    rise, back, front = rng.uniform(0.050, 0.065), -0.36 * long, rng.uniform(0.16, 0.24) * long
    path = curve([(0, front + 0.03, top - 0.010), (0, front + 0.008, top + 0.6 * rise), (0, front - 0.03, top + rise),
                  (0, 0.4 * back, top + rise), (0, 0.9 * back, top + 0.92 * rise), (0, back - 0.002, top + 0.5 * rise),
                  (0, back + 0.004, top - 0.010)], 36)  # fmt: skip
    bow = sweep(path, rng.uniform(0.0135, 0.0175), rng.uniform(0.75, 0.95), (1, 0, 0))
    dial = Manifold.cylinder(0.012, 0.016, 0.014, 32).translate((0, front - 0.042, top - 0.006))
    droop = curve([(0, back + 0.010, top + 0.86 * rise), (0, back - 0.030, top + 0.86 * rise),
                   (0, -0.5 * long - 0.012, top + 0.3 * rise), (0, -0.5 * long - 0.030, top - 0.030)], 22)  # fmt: skip
    tail = sweep(droop, 0.0036, up=(1, 0, 0), sides=12)
    return Solid("plate", plate), Solid("body", body), Solid("handle", bow), Solid("dial", dial), Solid("cord", tail)


def _boat(long: float, wide: float, point: float) -> np.ndarray:
    """Outline (n, 2) of a soleplate, round at the back (-y) and pointed in front."""
    s = np.linspace(-1, 1, 40)
    heel, toe = np.clip((-0.55 - s) / 0.45, 0, 1), np.clip(s + 0.55, 0, None) / 1.55
    half = wide / 2 * np.maximum(np.sqrt(np.clip(1 - heel**2, 0.05, 1)) - toe**point, 0.015)
    y = long / 2 * s
    return np.concatenate([np.stack([half, y], -1), np.stack([-half[::-1], y[::-1]], -1)])


def hair_dryer(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A hair dryer on the end of its handle: round fan housing, barrel, nozzle towards +y, a switch and a cord."""
    radius, long = rng.uniform(0.033, 0.043), rng.uniform(0.13, 0.17)
    grip_long, lean = rng.uniform(0.095, 0.125), rng.uniform(0.0, 0.18)
    axis = grip_long + radius * 0.9
    mouth = rng.uniform(0.50, 0.68) * radius
    line = curve([(0.70 * radius, -0.42 * long), (radius, -0.30 * long), (0.98 * radius, -0.05 * long),
                  (0.72 * radius, 0.30 * long), (1.12 * mouth, 0.45 * long)], 22)  # fmt: skip
    shell = lay_along_y(revolve(np.concatenate([[(0, line[0, 1])], line, [(0, line[-1, 1])]]))).translate((0, 0, axis))
    slit, reach = rng.uniform(0.28, 0.95), rng.uniform(0.045, 0.065)
    y = 0.45 * long - 0.006 + reach * np.linspace(0, 1, 8)
    t = np.linspace(0, 1, 8)
    wide, tall = mouth * (1 + rng.uniform(0.1, 0.5) * t * (1 - slit)), mouth * (1 - (1 - slit) * t**1.2)
    cone = bar(y, wide, tall, z=axis) - bar(y + 0.012, 0.86 * wide, np.maximum(tall - 0.0028, 0.5 * tall), z=axis)
    z = np.linspace(0.0, axis - 0.35 * radius, 16)
    thick = np.interp(z, [0, 0.006, z[-1]], [0.011, 0.0145, 0.0185])
    hold = sweep(np.stack([0 * z, -lean * (axis - z) - 0.06 * long, z], -1), thick, 1.15, (0, 1, 0))
    at = 0.62 * axis
    front = -lean * (axis - at) - 0.06 * long + 0.0165
    button = sweep([(0, front, at - 0.012), (0, front + 0.001, at), (0, front, at + 0.012)], 0.006, up=(1, 0, 0), sides=12)
    end = -lean * axis - 0.06 * long
    cord = sweep(curve([(0, end, 0.010), (0, end - 0.004, -0.020), (0, end - 0.020, -0.045)], 14), 0.0038, up=(1, 0, 0), sides=12)
    return (Solid("cord", cord), Solid("handle", hold), Solid("switch", button), Solid("body", shell), Solid("nozzle", cone))


def brush(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A washing-up or scrubbing brush lying on its back, bristles up."""
    rx, ry, deep = rng.uniform(0.020, 0.034), rng.uniform(0.032, 0.055), rng.uniform(0.018, 0.034)
    thick, stick = rng.uniform(0.010, 0.014), rng.uniform(0.12, 0.18)
    y, envelope = capped(-ry, ry, 0.9 * ry, 18)
    back = bar(y, rx * envelope, thick / 2 * np.maximum(envelope, 0.5), square=3.0)
    neck = curve([(0.010, -stick), (0.0135, -0.8 * stick), (0.011, -0.4 * stick), (0.0075, 0.0), (0.010, 0.014)], 20)
    _, round_ends = capped(-stick, 0.014, 0.012, 20)
    bow = rng.uniform(0.0, 0.018) * np.sin(np.linspace(0, np.pi, 20))
    hold = bar(neck[:, 1] - ry, neck[:, 0] * round_ends, 0.0062 * round_ends, z=bow, square=2.4)
    step = rng.uniform(0.0085, 0.0105)
    splay = rng.uniform(0.0, 0.25)
    tufts = [tuft(x, v, thick / 2 - 0.0045, deep, splay, 0.42 * step) for x, v in spots(rx - 0.006, ry - 0.008, step)]
    return Solid("handle", hold), Solid("head", back), *(Solid("bristles", tuft) for tuft in tufts)


def tuft(x: float, y: float, z: float, deep: float, splay: float, radius: float) -> Manifold:
    """A bundle of bristles that widens and leans outwards at its free end."""
    lean = splay * deep / 0.03
    ends = np.array([(x, y, z), (x * (1 + lean), y * (1 + lean), z + deep)])
    return sweep(ends, [0.72 * radius, radius], up=(0.0, 1.0, 0.0), sides=8)


def spots(half_x: float, half_y: float, step: float) -> list[tuple[float, float]]:
    """Return grid positions inside an ellipse."""
    xs, ys = (np.arange(-np.floor(half / step), np.floor(half / step) + 1) * step + 0.0003 for half in (half_x, half_y))
    return [(float(x), float(y)) for x in xs for y in ys if (x / half_x) ** 2 + (y / half_y) ** 2 <= 1.0]


def spatula(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A turner: a slotted head bent down from a thin shaft, and a handle."""
    wide, long = rng.uniform(0.030, 0.045), rng.uniform(0.075, 0.115)
    near, slots = rng.uniform(0.55, 0.9), int(rng.integers(3, 6))
    outline = [(-near * wide, 0), (near * wide, 0), (wide, 0.3 * long), (wide, long), (-wide, long), (-wide, 0.3 * long)]
    x = np.linspace(-0.62, 0.62, slots) * wide
    half = 0.62 * wide / slots * 0.55
    slot = np.array([(-half, 0.28 * long), (half, 0.28 * long), (half, 0.82 * long), (-half, 0.82 * long)])
    holes = tuple(slot + [a, 0] for a in x)
    head = sheet(outline, 0.0026, holes if rng.random() < 0.75 else (), 0.0024)
    rise = rng.uniform(0.018, 0.040)
    shaft = rng.uniform(0.09, 0.14)
    path = curve([(0, 0.014, 0.0), (0, -0.004, 0.002), (0, -0.035, rise), (0, -shaft, rise + 0.15 * shaft)], 22)
    stem = sweep(path, rng.uniform(0.0038, 0.0055), 0.7)
    slope = np.degrees(np.arctan2(path[-2, 2] - path[-1, 2], path[-2, 1] - path[-1, 1]))
    hold = bar_grip(rng, rng.uniform(0.10, 0.13), rng.uniform(0.009, 0.0125), rng.uniform(0.006, 0.009))
    hold = hold.rotate((float(slope), 0, 0))
    return Solid("handle", hold.translate(tuple(path[-1] + [0, 0.006, 0]))), Solid("shaft", stem), Solid("head", head)


def fork(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A table, serving or carving fork of two to four tines."""
    count, tine, stick = int(rng.integers(2, 5)), rng.uniform(0.045, 0.075), rng.uniform(0.11, 0.17)
    half = (0.0052 + 0.0012 * rng.random()) * (count - 1)
    y, envelope = capped(-stick, 0.010, 0.008, 26)
    s = np.linspace(0, 1, 26)
    wide = np.interp(s, [0, 0.1, 0.6, 0.9, 1.0], [0.0095, rng.uniform(0.0095, 0.0125), 0.006, 0.0045, 0.0055])
    arch = 0.006 + 0.008 * np.sin(np.pi * (y + stick) / stick)
    deep = np.interp(s, [0, 0.5, 1], [rng.uniform(0.0025, 0.0065), 0.0028, 0.0022])
    hold = bar(y, wide * envelope, deep * envelope, z=arch, square=2.6)
    outline = np.array([(-0.0045, 0), (0.0045, 0), (half + 0.0024, 0.022), (half + 0.0024, 0.034), (-half - 0.0024, 0.034),
                        (-half - 0.0024, 0.022)])  # fmt: skip
    palm = sheet(outline, 0.0030, (), 0.002).translate((0, 0, 0.0062))
    t = np.linspace(0, 1, 10)
    rise = 0.0062 - 0.0055 * np.sin(0.5 * np.pi * t) + rng.uniform(0.0, 0.012) * t**2
    thick = np.interp(t, [0, 0.85, 1], [0.0025, 0.0019, 0.0006])
    tine_of = np.stack([0 * t, 0.028 + (tine + 0.006) * t, rise], -1)
    tines = [sweep(tine_of + [x, 0, 0], thick, 0.75, sides=12) for x in np.linspace(-half, half, count)]
    return Solid("handle", hold), Solid("neck", palm), *(Solid("tines", shape) for shape in tines)


def toothbrush(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A manual (flat, slender or stout) or electric (thick round handle, round head) toothbrush, bristles upwards."""
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
    return (Solid("handle", bar_grip(rng, long, wide, deep)), Solid("neck", sweep(path, girth)), Solid("head", plate),
            *(Solid("bristles", tuft) for tuft in tufts))  # fmt: skip


def spray_bottle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A bottle (round, flat or square) with a collar, a head with a nozzle, and a trigger below it."""
    half_x, h = rng.uniform(0.026, 0.042), rng.uniform(0.10, 0.19)
    half_y, narrow = half_x * rng.uniform(0.65, 1.25), rng.uniform(0.012, 0.0155)
    t = np.array([0.0, 0.02, 0.10, 0.30, 0.50, rng.uniform(0.60, 0.80), 0.93, 1.0])
    waist = 1 - rng.uniform(0, 0.22) * np.array([0, 0, 0, 0.6, 1, 0.5, 0, 0])
    share = curve(np.stack([t, np.array([0.90, 0.98, 1, 1, 1, 1, 0, 0]) * waist], -1), 30)
    x, y = (narrow + (half - narrow) * np.clip(share[:, 1], 0, None) for half in (half_x, half_y))
    flask = stand_along_z(bar(-h * share[:, 0], x, y, square=rng.uniform(2.0, 4.5), sides=40)).rotate((180, 0, 0))
    tall, over = rng.uniform(0.014, 0.024), rng.uniform(1.15, 1.4) * narrow
    collar = revolve([(0, h - 0.006), (over, h - 0.006), (over, h + tall - 0.002), (0.85 * over, h + tall), (0, h + tall)], 32)
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
    pull = sweep(lever, np.linspace(0.0050, 0.0072, 20), 0.65, (0, 1, 0), sides=16)
    return (Solid("body", flask), Solid("neck", collar), Solid("head", top + neck), Solid("trigger", pull), Solid("nozzle", end))


def flashlight(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A flashlight, slender or stout, with a flared, plain or angled head, and a switch on its side or at its end."""
    long, radius = rng.uniform(0.07, 0.19), rng.uniform(0.010, 0.018)
    flare, deep = rng.uniform(1.15, 2.2), rng.uniform(0.028, 0.055)
    y, envelope = capped(-long, 0.006, 0.5 * radius, 60)
    grooves = 1 - 0.07 * (np.sin(y * 2 * np.pi / rng.uniform(0.007, 0.014)) > 0) * (y > -0.85 * long) * (y < -0.35 * long)
    tube = bar(y, radius * envelope * grooves, radius * envelope * grooves, square=float(rng.choice([2.0, 2.0, 3.5])))
    wide = flare * radius
    bell = revolve([(0, -0.004), (1.06 * radius, -0.004), (1.06 * radius, 0.006), (wide, 0.45 * deep), (wide, deep),
                   (0.86 * wide, deep), (0.80 * wide, deep - 0.004), (0, deep - 0.004)], 48)  # fmt: skip
    a = np.linspace(0, np.pi / 2, 8)
    bulge = rng.uniform(0.001, 0.30 * wide)
    glass = np.stack([0.83 * wide * np.cos(a), deep - 0.0035 + bulge * np.sin(a)], -1)
    pane = revolve([(0, deep - 0.006), (0.83 * wide, deep - 0.006), *glass[:-1], (0, glass[-1, 1])], 40)
    if rng.random() < 0.25:
        place = [shape.translate((0, -0.4 * radius, 0.6 * radius)) for shape in (bell, pane)]
    else:
        place = [lay_along_y(bell), lay_along_y(pane)]
    return Solid("body", tube), Solid("switch", _switch(rng, long, radius)), Solid("head", place[0]), Solid("lens", place[1])


def _switch(rng: np.random.Generator, long: float, radius: float) -> Manifold:
    """A button: a disc or a slide on the upper side, or a cap at the end."""
    kind, at = int(rng.integers(3)), -rng.uniform(0.12, 0.30) * long
    if kind == 0:
        return block((1.1 * radius, rng.uniform(1.4, 2.4) * radius, 0.5 * radius), (0, at, 0.98 * radius), 0.001)
    if kind == 1:
        return Manifold.cylinder(0.5 * radius, 0.62 * radius, 0.5 * radius, 28).translate((0, at, 0.75 * radius))
    cap = revolve([(0, -0.010), (0.5 * radius, -0.009), (0.62 * radius, -0.005), (0.62 * radius, 0.006), (0, 0.006)], 28)
    return lay_along_y(cap).translate((0, 0.002 - long, 0))


def candle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A candle in a portable holder: a saucer or a cup on a foot, with a ring, an ear or a stick to hold."""
    thick, tall = rng.uniform(0.0095, 0.022), rng.uniform(0.045, 0.16)
    plate, lip = thick + rng.uniform(0.022, 0.045), rng.uniform(0.006, 0.016)
    stand = float(rng.choice([0.0, rng.uniform(0.02, 0.09)]))
    dish = revolve([(0, 0), (0.8 * plate, 0), (plate, lip), (plate - 0.003, lip + 0.001), (0.78 * plate, 0.0045), (0, 0.0045)], 56)
    cup, top = 1.25 * thick + 0.002, stand + 0.022
    post = revolve([(0, 0.002), (cup + 0.004, 0.002), (0.75 * cup, 0.010 + 0.3 * stand), (0.75 * cup, 0.003 + 0.8 * stand),
                   (cup, 0.010 + stand), (cup, top), (0, top)], 36)  # fmt: skip
    z = np.linspace(top - 0.008, top + tall, 16)
    lean = np.interp(z, [z[0], z[-2], z[-1]], [1.0, rng.uniform(0.7, 1.0), 0.6])
    wax = revolve(np.concatenate([[(0, z[0])], np.stack([thick * lean, z], -1), [(0, z[-1] - 0.001)]]), 36)
    bend = rng.uniform(-0.004, 0.004)
    end = top + tall
    wick = sweep(curve([(0, 0, end - 0.006), (0, 0, end + 0.005), (0, bend, end + rng.uniform(0.017, 0.024))], 12),
                 np.linspace(0.0036, 0.0026, 12), up=(1, 0, 0), sides=12)  # fmt: skip
    return Solid("holder", dish + post), Solid("handle", _ear(rng, plate, lip)), Solid("body", wax), Solid("wick", wick)


def _ear(rng: np.random.Generator, plate: float, lip: float) -> Manifold:
    """Carrying handle of the holder, beyond the edge of its plate."""
    kind, radius = int(rng.integers(3)), rng.uniform(0.014, 0.021)
    if kind == 0:
        stood = hoop(radius, radius, rng.uniform(0.0036, 0.0055), rng.uniform(1.0, 1.6)).rotate((0, 90, 0))
        return stood.translate((0, -plate - radius + 0.003, lip + 0.5 * radius))
    if kind == 1:
        return ring_grip(rng, radius, rng.uniform(0.0040, 0.0058)).translate((0, 0.001 - plate, 0.75 * lip))
    stick = bar_grip(rng, rng.uniform(0.05, 0.09), rng.uniform(0.007, 0.011), rng.uniform(0.0045, 0.0070))
    return stick.rotate((-rng.uniform(0, 25), 0, 0)).translate((0, 0.001 - plate, 0.7 * lip + 0.001))


BUILDERS = {"iron": iron, "hair_dryer": hair_dryer, "brush": brush, "spatula": spatula, "fork": fork, "toothbrush": toothbrush,
            "spray_bottle": spray_bottle, "flashlight": flashlight, "candle": candle}  # fmt: skip
