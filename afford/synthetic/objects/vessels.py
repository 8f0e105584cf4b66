"""Vessels: mug, pan, pot, kettle, ladle. They stand upright; the handle points towards -y, a spout towards +y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import Solid, bar, bar_grip, capped, curve, revolve, sweep


def hollow(side: np.ndarray, h: float, wall: float, base: float) -> tuple[Manifold, Manifold]:
    """An open vessel whose outer radius follows `side` from foot to rim, and the solid that fills it to the middle of its wall."""
    z = np.linspace(0.004, h, len(side))
    outer = np.stack([side, z], -1)
    inner = np.stack([side - wall, np.maximum(z, base)], -1)
    inner = inner[(z >= base) | (np.arange(len(z)) == 0)]
    foot = [(0, 0), (side[0] - 0.004, 0)]
    shape = revolve(np.concatenate([foot, outer, [(side[-1] - wall / 2, h + 0.0012)], inner[::-1], [(0, base)]]), 64)
    middle = np.stack([side - wall / 2, np.maximum(z, base / 2)], -1)
    return shape, revolve(np.concatenate([[(0, base / 2)], middle, [(side[-1] - wall / 2, h + 0.05), (0, h + 0.05)]]), 64)


def spout_along(path: np.ndarray, thick: np.ndarray) -> tuple[Manifold, Manifold]:
    """A spout along a path, and the lip around the opening at its end."""
    end = (path[-1] - path[-2]) / np.linalg.norm(path[-1] - path[-2])
    reach = [sweep(path[-1] + np.outer(ends, end), share * thick[-1], up=(1, 0, 0))
             for ends, share in (((-0.020, 0.010), 0.76), ((-0.009, 0.001), 1.14), ((-0.018, 0.010), 0.70))]  # fmt: skip
    return sweep(path, thick, up=(1, 0, 0)) - reach[0], reach[1] - reach[2]


def bow_behind(rng: np.random.Generator, line: np.ndarray, top: float, h: float) -> Manifold:
    """A handle behind the body, from its shoulder to its belly."""
    high, low = 0.90 * h, rng.uniform(0.22, 0.38) * h
    start, stop = (float(np.interp(z, line[:, 1], line[:, 0])) for z in (high, low))
    out = stop + rng.uniform(0.036, 0.050)
    path = curve([(0, -start + 0.008, high), (0, -0.75 * out, high + 0.010), (0, -out, 0.72 * h), (0, -out, 0.55 * h),
                  (0, -stop + 0.008, low)], 26)  # fmt: skip
    return sweep(path, rng.uniform(0.0085, 0.0115), 0.75, (1, 0, 0))


def arch_above(rng: np.random.Generator, top: float, h: float, dome: float) -> Manifold:
    """A handle above the lid, from front to back."""
    s = np.linspace(0, np.pi, 26)
    rise = dome + rng.uniform(0.065, 0.090)
    path = np.stack([0 * s, 1.02 * top * np.cos(s), h - 0.008 + rise * np.sin(s) ** 0.6], -1)
    return sweep(path, np.interp(np.sin(s), [0, 1], [0.006, rng.uniform(0.0085, 0.011)]), 0.8, (1, 0, 0))


def knob_on(radius: float, z: float) -> Manifold:
    """A knob on a lid whose top is at this height."""
    y, envelope = capped(z - 0.003, z + 1.5 * radius, 0.6 * radius, 14)
    waist = np.interp(y, [z - 0.003, z + 0.4 * radius, z + 0.9 * radius], [0.55, 0.55, 1.0])
    return revolve(np.concatenate([[(0, y[0])], np.stack([radius * waist * np.maximum(envelope, 0.3), y], -1), [(0, y[-1])]]), 28)


def mug(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A hollow mug, straight, tapering or bellied; its rim is the upper centimetre."""
    r, h, wall = rng.uniform(0.034, 0.047), rng.uniform(0.075, 0.115), rng.uniform(0.0032, 0.0045)
    t = np.linspace(0, 1, 14)
    side = r * (1 + rng.uniform(-0.16, 0.12) * (1 - t) + rng.uniform(-0.03, 0.10) * np.sin(np.pi * t))
    vessel, core = hollow(side, h, wall, 0.006)
    z = h * np.linspace(rng.uniform(0.84, 0.90), rng.uniform(0.16, 0.30), 20)
    out, thick = rng.uniform(0.024, 0.036), rng.uniform(0.0048, 0.0075)
    bow = np.interp(z / h, t, side) - wall / 2 + out * np.sin(np.linspace(0, np.pi, 20)) ** rng.uniform(0.45, 0.9)
    ear = sweep(np.stack([0 * z, -bow, z], -1), thick, rng.uniform(1.0, 1.5), (1, 0, 0)) - core
    rim, body = vessel.split_by_plane((0, 0, 1), h - rng.uniform(0.008, 0.011))
    return Solid("handle", ear), Solid("body", body), Solid("rim", rim)


def pan(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A frying pan or a saucepan with one long handle."""
    r, deep = rng.uniform(0.075, 0.125), rng.uniform(0.035, 0.085)
    t = np.linspace(0, 1, 12)
    side = r * (1 - rng.uniform(0.02, 0.20) * (1 - t) ** 1.5)
    vessel, core = hollow(side, deep, 0.0036, 0.0045)
    length, rise = rng.uniform(0.14, 0.20), rng.uniform(0.0, 0.35)
    hold = bar_grip(rng, length, rng.uniform(0.0105, 0.0145), rng.uniform(0.007, 0.010)).translate((0, -r - 0.022, 0))
    root = bar(np.linspace(-r - 0.032, -r + 0.006, 6), [0.0085, 0.0085, 0.008, 0.010, 0.014, 0.015], 0.0045, square=3.0)
    place = {"handle": hold, "neck": root}
    lift = rng.uniform(0.72, 0.86) * deep
    placed = {part: shape.translate((0, r, 0)).rotate((-np.degrees(np.arctan(rise)), 0, 0)).translate((0, -r, lift))
              for part, shape in place.items()}  # fmt: skip
    return Solid("handle", placed["handle"]), Solid("neck", placed["neck"] - core), Solid("body", vessel)


def pot(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A cooking pot under its lid, with a loop handle at each side."""
    r, h = rng.uniform(0.085, 0.125), rng.uniform(0.09, 0.15)
    foot = rng.uniform(0.90, 1.0) * r
    body = revolve([(0, 0), (foot - 0.006, 0), (foot, 0.006), (r, h - 0.006), (r + 0.004, h - 0.004), (r + 0.004, h), (0, h)])
    dome = rng.uniform(0.012, 0.032)
    a = np.linspace(0, np.pi / 2, 10)
    arch = np.stack([(r - 0.004) * np.cos(a), h + 0.003 + dome * np.sin(a)], -1)
    edge = [(0, h - 0.003), (r - 0.004, h - 0.003), (r + 0.002, h + 0.001), (r + 0.002, h + 0.003)]
    lid = revolve([*edge, *arch[:-1], (0, arch[-1, 1])])
    out, thick = rng.uniform(0.026, 0.038), rng.uniform(0.0052, 0.0075)
    s = np.linspace(0, np.pi, 22)
    wide = rng.uniform(0.035, 0.048)
    high = rng.uniform(0.66, 0.84)
    root = np.sqrt((foot + high * (r - foot)) ** 2 - wide**2) - 0.004
    bow = np.stack([-wide * np.cos(s), -root - (r + out - root) * np.sin(s) ** 0.5, 0 * s + high * h], -1)
    loop = sweep(bow, thick, 0.8)
    knob = knob_on(rng.uniform(0.012, 0.018), h + dome)
    return Solid("handle", loop + loop.rotate((0, 0, 180))), Solid("body", body), Solid("lid", lid), Solid("knob", knob)


def kettle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A kettle: round body, lid with knob, spout with its opening, and a handle behind or above."""
    r, h = rng.uniform(0.070, 0.092), rng.uniform(0.11, 0.19)
    top, belly = rng.uniform(0.50, 0.68) * r, rng.uniform(0.10, 0.40)
    line = curve([(r * 0.93, 0.0), (r, 0.012), (r * (1 - 0.1 * belly), belly * h + 0.02), (top, h)], 18)
    body = revolve(np.concatenate([[(0, 0)], line, [(0, h)]]))
    a = np.linspace(0, np.pi / 2, 8)
    dome = rng.uniform(0.010, 0.022)
    arch = np.stack([top * 0.94 * np.cos(a), h + 0.002 + dome * np.sin(a)], -1)
    lid = revolve([(0, h - 0.004), (top * 0.94, h - 0.004), *arch[:-1], (0, arch[-1, 1])])
    at = rng.uniform(0.30, 0.55)
    root = float(np.interp(at * h, line[:, 1], line[:, 0]))
    long = rng.uniform(0.045, 0.075)
    path = curve([(0, root - 0.020, at * h), (0, root + 0.35 * long, at * h + 0.012), (0, root + 0.7 * long, 0.72 * h),
                  (0, root + long, rng.uniform(0.88, 1.0) * h)], 26)  # fmt: skip
    spout, mouth = spout_along(path, np.linspace(rng.uniform(0.017, 0.022), rng.uniform(0.0085, 0.0115), 26))
    bow = bow_behind(rng, line, h + dome, h) if rng.random() < 0.55 else arch_above(rng, top, h, dome)
    knob = knob_on(rng.uniform(0.008, 0.012), h + dome)
    return (Solid("handle", bow), Solid("body", body), Solid("lid", lid), Solid("knob", knob), Solid("spout", spout),
            Solid("opening", mouth))  # fmt: skip


def ladle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A round bowl and a long rising handle with a hook at its end."""
    r, length, wall = rng.uniform(0.032, 0.046), rng.uniform(0.20, 0.28), 0.0026
    a = np.linspace(0.02, rng.uniform(0.44, 0.52) * np.pi, 14)
    cup = np.stack([r * np.sin(a), r * 0.85 * (1 - np.cos(a))], -1)
    inside = cup * [(r - wall) / r, 0.93] + [0, wall]
    inside[-1, 1] = cup[-1, 1]
    bowl = revolve(np.concatenate([[(0, 0)], cup, inside[::-1], [(0, wall)]]))
    core = revolve(np.concatenate([[(0, wall / 2)], cup * [(r - wall / 2) / r, 1] + [0, wall / 2], [(0, cup[-1, 1] + 0.05)]]))
    rim, rise = float(cup[-1, 1]), rng.uniform(0.02, 0.10)
    path = curve([(0, -r + 0.001, rim - 0.005), (0, -r - 0.018, rim + 0.010), (0, -r - 0.5 * length, rim + 0.010 + 0.55 * rise),
                  (0, -r - length, rim + 0.010 + rise), (0, -r - length - 0.016, rim + 0.004 + rise),
                  (0, -r - length - 0.010, rim - 0.012 + rise)], 36)  # fmt: skip
    width = np.interp(np.linspace(0, 1, 36), [0, 0.2, 0.6, 1], [0.0045, 0.0048, rng.uniform(0.0065, 0.0095), 0.0050])
    return Solid("handle", sweep(path, width, rng.uniform(0.4, 0.7), (0, 0.3, 1)) - core), Solid("bowl", bowl)


BUILDERS = {"mug": mug, "pan": pan, "pot": pot, "kettle": kettle, "ladle": ladle}
