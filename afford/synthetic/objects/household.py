"""Things of the house: iron, hair dryer, brush, spatula, fork. The handle points towards -y, what works towards +y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.handles import grip
from afford.synthetic.objects.solids import Solid, bar, capped, curve, laid, loft, sheet, swept, turned


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
    bow = swept(path, rng.uniform(0.0135, 0.0175), rng.uniform(0.75, 0.95), (1, 0, 0))
    dial = Manifold.cylinder(0.012, 0.016, 0.014, 32).translate((0, front - 0.042, top - 0.006))
    droop = curve([(0, back + 0.010, top + 0.86 * rise), (0, back - 0.030, top + 0.86 * rise),
                   (0, -0.5 * long - 0.012, top + 0.3 * rise), (0, -0.5 * long - 0.030, top - 0.030)], 22)  # fmt: skip
    tail = swept(droop, 0.0036, up=(1, 0, 0), sides=12)
    return Solid("plate", plate), Solid("body", body), Solid("handle", bow), Solid("dial", dial), Solid("cord", tail)


def _boat(long: float, wide: float, point: float) -> np.ndarray:
    """(n, 2) outline of a sole: round at the back (-y), pointed in front."""
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
    shell = laid(turned(np.concatenate([[(0, line[0, 1])], line, [(0, line[-1, 1])]]))).translate((0, 0, axis))
    slit, reach = rng.uniform(0.28, 0.95), rng.uniform(0.045, 0.065)
    y = 0.45 * long - 0.006 + reach * np.linspace(0, 1, 8)
    t = np.linspace(0, 1, 8)
    wide, tall = mouth * (1 + rng.uniform(0.1, 0.5) * t * (1 - slit)), mouth * (1 - (1 - slit) * t**1.2)
    cone = bar(y, wide, tall, z=axis) - bar(y + 0.012, 0.86 * wide, np.maximum(tall - 0.0028, 0.5 * tall), z=axis)
    z = np.linspace(0.0, axis - 0.35 * radius, 16)
    thick = np.interp(z, [0, 0.006, z[-1]], [0.011, 0.0145, 0.0185])
    hold = swept(np.stack([0 * z, -lean * (axis - z) - 0.06 * long, z], -1), thick, 1.15, (0, 1, 0))
    at = 0.62 * axis
    front = -lean * (axis - at) - 0.06 * long + 0.0165
    button = swept([(0, front, at - 0.012), (0, front + 0.001, at), (0, front, at + 0.012)], 0.006, up=(1, 0, 0), sides=12)
    end = -lean * axis - 0.06 * long
    cord = swept(curve([(0, end, 0.010), (0, end - 0.004, -0.020), (0, end - 0.020, -0.045)], 14), 0.0038, up=(1, 0, 0), sides=12)
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
    """A bundle of bristles, wider and leaning outwards at its free end."""
    lean = splay * deep / 0.03
    ends = np.array([(x, y, z), (x * (1 + lean), y * (1 + lean), z + deep)])
    return swept(ends, [0.72 * radius, radius], up=(0.0, 1.0, 0.0), sides=8)


def spots(half_x: float, half_y: float, step: float) -> list[tuple[float, float]]:
    """Places on a grid inside an ellipse."""
    xs, ys = (np.arange(-np.floor(half / step), np.floor(half / step) + 1) * step + 0.0003 for half in (half_x, half_y))
    return [(float(x), float(y)) for x in xs for y in ys if (x / half_x) ** 2 + (y / half_y) ** 2 <= 1.0]


def spatula(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A turner: a slotted head that is bent down from a thin shaft, and a handle."""
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
    stem = swept(path, rng.uniform(0.0038, 0.0055), 0.7)
    slope = np.degrees(np.arctan2(path[-2, 2] - path[-1, 2], path[-2, 1] - path[-1, 1]))
    hold = grip(rng, rng.uniform(0.10, 0.13), rng.uniform(0.009, 0.0125), rng.uniform(0.006, 0.009)).rotate((float(slope), 0, 0))
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
    tines = [swept(tine_of + [x, 0, 0], thick, 0.75, sides=12) for x in np.linspace(-half, half, count)]
    return Solid("handle", hold), Solid("neck", palm), *(Solid("tines", shape) for shape in tines)


BUILDERS = {"iron": iron, "hair_dryer": hair_dryer, "brush": brush, "spatula": spatula, "fork": fork}
