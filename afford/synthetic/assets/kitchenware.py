"""Objects that only training kitchens contain: jug, ladle, fork, whisk, pot, glass, pepper grinder, brush."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from afford.render import materials
from afford.render.mesh import Mesh, merge, mesh, transform, translate
from afford.render.motion import axis_angle, pose
from afford.render.scene import Material
from afford.render.solids import extrude, lathe, tube
from afford.synthetic.assets.object_model import (
    UP,
    Grip,
    ObjectModel,
    Part,
    Vec,
    along,
    around,
    edge,
    over,
    pinch,
    rod,
    with_mirror,
)

TINTS = ((206, 222, 226), (196, 218, 204), (222, 214, 196), (172, 190, 214), (214, 188, 160))
"""Tints of glass tumblers."""


def jug(rng: np.random.Generator) -> ObjectModel:
    """An open jug with a lip (+y) and one handle at the back (-y)."""
    foot, r, h = rng.uniform(0.040, 0.052), rng.uniform(0.046, 0.056), rng.uniform(0.15, 0.20)
    throat, mouth, wall = r * rng.uniform(0.72, 0.96), r * rng.uniform(0.84, 1.05), 0.004
    s = np.linspace(0, 1, 14)
    radius = np.interp(s, [0, 0.4, 0.78, 1], [foot, r, throat, mouth])
    radius = np.convolve(np.pad(radius, 2, mode="edge"), np.ones(5) / 5, "valid")
    side = np.stack([radius, 0.004 + (h - 0.004) * s], -1)
    outer = lathe(np.concatenate([[(0, 0), (foot - 0.004, 0)], side]), 56, repeat_u=2.0)
    inner = lathe(np.concatenate([side[-1:], side[:0:-1] - [wall, 0], [(0, 0.02)]]), 56)
    z = h * np.linspace(0.90, 0.26, 15)
    bow = np.interp(z, side[:, 1], radius) - 0.003 + 0.050 * np.sin(np.linspace(0, np.pi, 15)) ** 0.55
    handle = tube(np.stack([0 * z, -bow, z], -1), rng.uniform(0.0065, 0.0085), 12, up=(1, 0, 0), flat=1.3)
    skin = _any(rng, materials.ceramic, materials.plastic, materials.metal)
    plain = skin if rng.random() < 0.5 else materials.plastic(rng)
    parts = (Part("body", _lipped(outer, h), skin), Part("inside", _lipped(inner, h), plain), Part("handle", handle, plain))
    grips = with_mirror(rod("handle", (0.0, -float(bow[7]), 0.58 * h), UP, (-0.94, 0.34, 0.0), 0.018, lean_deg=-12.0))
    return ObjectModel("jug", "jug", parts, grips, opening=(0.0, 0.0, h))


def ladle(rng: np.random.Generator) -> ObjectModel:
    """A ladle resting on its bowl and on the end of its handle, which points towards -y."""
    r, length, steel = rng.uniform(0.034, 0.043), rng.uniform(0.20, 0.25), rng.random() < 0.6
    a = np.linspace(0, 0.46 * np.pi, 9)
    cup = np.stack([r * np.sin(a), r * 0.85 * (1 - np.cos(a))], -1)
    bowl = lathe(np.concatenate([cup, cup[::-1] * [0.93, 1.0] + [0, 0.0015]]), 40)
    y, top = np.linspace(-r - length, -r + 0.004, 16), float(cup[-1, 1]) - 0.004
    z = np.interp(y, [y[0], y[-1]], [0.0075, top]) + 0.010 * np.sin(np.linspace(0, np.pi, 16))
    stick = tube(np.stack([0 * y, y, z], -1), np.interp(y, [y[0], y[5], y[-1]], [0.0092, 0.0070, 0.0050]), 12, flat=0.7)
    look = materials.metal(rng) if steel else materials.plastic(rng)
    held = look if rng.random() < 0.4 else materials.plastic(rng)
    shift = length / 2
    at = (0.0, float(y[4]) + shift, float(z[4]))
    parts = (Part("bowl", translate(bowl, 0, shift), look), Part("handle", translate(stick, 0, shift), held))
    return ObjectModel("ladle", "ladle", parts, _stick(at, 0.016), tip=(0.0, shift, 0.004))


def fork(rng: np.random.Generator) -> ObjectModel:
    """A large serving fork with two to four tines, handle towards -y."""
    stick, count, tine = rng.uniform(0.15, 0.19), int(rng.integers(2, 5)), rng.uniform(0.055, 0.075)
    half = 0.0055 * (count - 1) + rng.uniform(0.002, 0.005)
    y = np.linspace(-stick, 0.0, 14)
    z = 0.0085 + 0.006 * np.sin(np.linspace(0, np.pi, 14))
    handle = tube(np.stack([0 * y, y, z], -1), np.interp(y, [-stick, -0.5 * stick, 0], [0.0095, 0.0078, 0.0042]), 14, flat=0.75)
    root = np.array([(-0.004, -0.006), (0.004, -0.006), (half + 0.002, 0.022), (half + 0.002, 0.030), (-half - 0.002, 0.030),
                     (-half - 0.002, 0.022)])  # fmt: skip
    t = np.linspace(0.026, 0.026 + tine, 8)
    rise = 0.0085 - 0.006 * np.sin(np.linspace(0, 0.8 * np.pi, 8))
    tines = [tube(np.stack([0 * t + x, t, rise], -1), np.linspace(0.0028, 0.0014, 8), 8) for x in np.linspace(-half, half, count)]
    steel = materials.metal(rng)
    held = steel if rng.random() < 0.33 else _any(rng, materials.wood, materials.plastic)
    shift = (stick - tine - 0.026) / 2
    head = translate(merge(translate(extrude(root, 0.003), 0, 0, 0.0075), *tines), 0, shift)
    parts = (Part("handle", translate(handle, 0, shift), held), Part("head", head, steel))
    at = (0.0, shift - 0.66 * stick, float(np.interp(-0.66 * stick, y, z)))
    return _at_rest(ObjectModel("fork", "fork", parts, _stick(at, 0.016), tip=(0.0, shift + tine, 0.004)))


def whisk(rng: np.random.Generator) -> ObjectModel:
    """A balloon whisk resting on its wires and on the end of its handle, which points towards -y."""
    stick, wires, r = rng.uniform(0.10, 0.13), rng.uniform(0.13, 0.16), rng.uniform(0.026, 0.034)
    s = np.linspace(0, np.pi, 41)
    loop = np.stack([r * np.sin(s) ** 0.8 * (1 - 0.42 * np.cos(s)), 0.5 * wires * (1 - np.cos(s)), 0 * s], -1)
    half = tube(loop, 0.0017, 6)
    turns = np.arange(10) * (2 * np.pi / 10)
    balloon = merge(*(transform(half, pose((0, 0, 0), axis_angle((0, 1, 0), turn))) for turn in turns))
    y = np.linspace(-stick, 0.006, 12)
    thick = np.interp(y, [-stick, -0.45 * stick, 0], [0.0125, 0.0105, 0.0075])
    handle = tube(np.stack([0 * y, y, 0 * y], -1), thick, 16)
    steel = materials.metal(rng, tone=185)
    held = steel if rng.random() < 0.33 else _any(rng, materials.wood, materials.plastic)
    shift, slope = (stick - wires) / 2, (r - 0.0125) / (stick + 0.62 * wires)
    lean = pose((0, shift, 0), axis_angle((1, 0, 0), np.arctan(slope)))
    parts = (Part("handle", transform(handle, lean), held), Part("wires", transform(balloon, lean), steel))
    at = tuple(float(v) for v in (lean @ [0, -0.55 * stick, 0, 1])[:3])
    return _at_rest(ObjectModel("whisk", "whisk", parts, _stick((at[0], at[1], at[2]), 0.022), tip=(0.0, shift + wires, r)))


def pot(rng: np.random.Generator) -> ObjectModel:
    """An open cooking pot with a loop handle at each side."""
    r, h, out = rng.uniform(0.085, 0.105), rng.uniform(0.085, 0.12), rng.uniform(0.030, 0.038)
    side = lathe(np.array([(0, 0), (r - 0.008, 0), (r, 0.008), (r, h - 0.003), (r + 0.004, h)]), 64, repeat_u=4.0)
    inside = lathe(np.array([(r + 0.004, h), (r - 0.003, h - 0.002), (r - 0.003, 0.010), (r - 0.010, 0.005), (0, 0.005)]), 64)
    s = np.linspace(0, np.pi, 17)
    bow = np.stack([r - 0.004 + out * np.sin(s) ** 0.5, -0.040 * np.cos(s), 0 * s + 0.80 * h], -1)
    loop = tube(bow, rng.uniform(0.0055, 0.0075), 12, flat=0.8)
    other = transform(loop, pose((0, 0, 0), axis_angle((0, 0, 1), np.pi)))
    coat = materials.metal(rng) if rng.random() < 0.5 else materials.plastic(rng)
    held = materials.plastic(rng, (42, 40, 42)) if rng.random() < 0.5 else materials.metal(rng)
    parts = (
        Part("outside", side, coat),
        Part("inside", inside, materials.metal(rng)),
        Part("handle", merge(loop, other), held),
    )
    grips = edge("handle", (r + out + 0.004, 0.0, 0.80 * h + 0.006), 0.012)
    return ObjectModel("pot", "pot", parts, grips, opening=(0.0, 0.0, h))


def glass(rng: np.random.Generator) -> ObjectModel:
    """A tumbler, round or faceted, straight or wider at the top."""
    r, h, sides = rng.uniform(0.030, 0.036), rng.uniform(0.095, 0.14), [8, 10, 12, 48][rng.integers(4)]
    top, wall, base = r * rng.uniform(1.0, 1.22), 0.0025, rng.uniform(0.008, 0.016)
    outer = lathe(np.array([(0, 0), (r - 0.002, 0), (r, 0.003), (top, h - 0.001), (top - wall / 2, h)]), sides, crease_deg=25.0)
    inner = lathe(np.array([(top - wall / 2, h), (top - wall, h - 0.001), (r - wall, base), (0, base)]), sides, crease_deg=25.0)
    tint = TINTS[rng.integers(len(TINTS))]
    clear = replace(materials.plastic(rng, tint), specular=0.10, roughness=0.12)
    deep = replace(materials.plastic(rng, tuple(int(0.82 * c) for c in tint)), specular=0.08, roughness=0.2)
    middle = (r + top) / 2
    grips = (*around("body", middle, 0.5 * h), *over("rim", top, 0.97 * h))
    return ObjectModel("glass", "glass", (Part("body", outer, clear), Part("inside", inner, deep)), grips, spins=True,
                       opening=(0.0, 0.0, h))  # fmt: skip


def grinder(rng: np.random.Generator) -> ObjectModel:
    """A turned pepper mill whose head turns against its body."""
    r, h, waist = rng.uniform(0.027, 0.032), rng.uniform(0.17, 0.25), rng.uniform(0.60, 0.78)
    neck = rng.uniform(0.70, 0.76)
    s = np.linspace(0, 1, 24)
    turned = r * np.interp(s, [0, 0.10, 0.16, 0.55, 0.82, 0.92, 1], [1, 1, 0.90, waist, 0.92, 0.92, 0.72])
    body = lathe(np.concatenate([[(0, 0), (r - 0.002, 0)], np.stack([turned, 0.002 + neck * h * s], -1), [(0, neck * h)]]), 40)
    a = np.linspace(-0.36 * np.pi, 0.5 * np.pi, 12)
    deep = (0.96 - neck) * h / (1 + np.sin(0.36 * np.pi))
    dome = np.stack([0.95 * r * np.cos(a), neck * h + deep * (np.sin(a) + np.sin(0.36 * np.pi))], -1)
    head = lathe(np.concatenate([[(0.4 * r, neck * h)], dome]), 40)
    knob = lathe(np.array([(0.006, 0.955 * h), (0.0085, 0.97 * h), (0.0075, 0.99 * h), (0, h)]), 20)
    look = materials.wood(rng, size=256) if rng.random() < 0.6 else materials.plastic(rng)
    parts = (Part("body", body, look), Part("head", head, look if rng.random() < 0.7 else materials.metal(rng)),
             Part("knob", knob, materials.metal(rng)))  # fmt: skip
    grips = (*around("body", 0.82 * r, 0.42 * h), *over("head", 0.95 * r, 0.95 * h))
    return ObjectModel("grinder", "mill:pepper", parts, grips, spins=True)


def brush(rng: np.random.Generator) -> ObjectModel:
    """A dish brush, handle towards -y, lying on its back or on its bristles."""
    stick, rx, ry, deep = rng.uniform(0.15, 0.19), rng.uniform(0.022, 0.030), rng.uniform(0.030, 0.040), rng.uniform(0.022, 0.030)
    turned, thick = rng.random() < 0.6, 0.011
    tuft = _tuft(deep) if not turned else translate(transform(_tuft(deep), np.diag([1.0, 1.0, -1.0, 1.0])), 0, 0, thick + deep)
    tufts = merge(*(translate(tuft, x * 1.08, y * 1.08) for x, y in _spots(rx - 0.003, ry - 0.003, 0.0095)))
    a = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    back = translate(extrude(np.stack([rx * np.cos(a), ry * np.sin(a)], -1), thick), 0, 0, 0 if turned else deep)
    y = np.linspace(-ry - stick, -ry + 0.012, 16)
    z = np.interp(y, [y[0], y[-1]], [0.0085, 0.006 if turned else deep + 0.006]) + 0.006 * np.sin(np.linspace(0, np.pi, 16))
    handle = tube(np.stack([0 * y, y, z], -1), np.interp(y, [y[0], y[6], y[-1]], [0.0110, 0.0095, 0.0075]), 14, flat=0.72)
    look = materials.wood(rng, size=256) if rng.random() < 0.5 else materials.plastic(rng)
    hair = materials.plastic(rng, (232, 226, 208)) if rng.random() < 0.6 else materials.plastic(rng)
    shift = stick / 2
    parts = (Part("back", translate(back, 0, shift), look), Part("bristles", translate(tufts, 0, shift), hair),
             Part("handle", translate(handle, 0, shift), look))  # fmt: skip
    return ObjectModel("brush", "brush", parts, _stick((0.0, float(y[5]) + shift, float(z[5])), 0.018), tip=(0.0, shift, 0.0))


def _stick(at: Vec, thickness: float) -> tuple[Grip, ...]:
    """Return the grips of a lying handle: with the fingertips, or with the whole hand."""
    return (*pinch("handle", at, thickness), *along("handle", at, thickness, tilt_deg=55.0))


def _any(rng: np.random.Generator, *looks: Callable[[np.random.Generator], Material]) -> Material:
    """Choose one of several materials at random."""
    return looks[int(rng.integers(len(looks)))](rng)


def _lipped(shape: Mesh, height: float) -> Mesh:
    """Draw the rim of a vessel out to a lip towards +y."""
    v = shape.vertices.astype(np.float64)
    ahead = np.clip(v[:, 1] / np.maximum(np.hypot(v[:, 0], v[:, 1]), 1e-6), 0, 1) ** 8
    pull = ahead * np.clip((v[:, 2] / height - 0.72) / 0.28, 0, 1) ** 1.5
    bent = v + pull[:, None] * [0, 0.018, 0.004]
    return mesh(bent, shape.faces, shape.uv)


def _tuft(height: float) -> Mesh:
    """A bundle of bristles that widens at its free end."""
    return lathe(np.array([(0, 0), (0.0052, 0.0005), (0.0036, height)]), 8)


def _spots(half_x: float, half_y: float, step: float) -> list[tuple[float, float]]:
    """Return grid positions inside an ellipse."""
    xs, ys = (np.arange(-np.floor(half / step), np.floor(half / step) + 1) * step for half in (half_x, half_y))
    return [(float(x), float(y)) for x in xs for y in ys if (x / half_x) ** 2 + (y / half_y) ** 2 <= 1.0]


def _at_rest(model: ObjectModel) -> ObjectModel:
    """Shift a model vertically until its lowest point is on the table."""
    z = -float(model.points[:, 2].min())
    grips = tuple(replace(grip, T_obj_palm=pose((0, 0, z), np.eye(3)) @ grip.T_obj_palm) for grip in model.grips)
    return replace(model, parts=tuple(replace(part, mesh=translate(part.mesh, 0, 0, z)) for part in model.parts), grips=grips)


BUILDERS = {"jug": jug, "ladle": ladle, "fork": fork, "whisk": whisk, "pot": pot, "glass": glass, "grinder": grinder,
            "brush": brush}  # fmt: skip
