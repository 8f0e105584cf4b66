"""Workshop objects: hammer, screwdriver, drill, wrench, saw, toolbox, glue, wood block, paint can. Tools lie, handle at -y."""

from __future__ import annotations

import numpy as np

from afford.render import materials
from afford.render.mesh import merge, transform, translate
from afford.render.solids import box, extrude, lathe, tube
from afford.synthetic.assets.object_model import (
    LEFT,
    UP,
    Joint,
    ObjectModel,
    Part,
    along,
    around,
    edge,
    over,
    pinch,
    rod,
    sides,
    with_mirror,
)

LIE_Y = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Rotation of a shape along z so that it lies along y."""
TO_X = np.array([[0, 0, 1.0, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
"""Rotation of a shape along z so that it lies along x."""


def hammer(rng: np.random.Generator) -> ObjectModel:
    """A claw hammer on its side: head along x at +y, face at +x."""
    long = rng.uniform(0.25, 0.29)
    y = np.linspace(-long / 2, long / 2, 18)
    stick = tube(
        np.stack([0 * y, y, 0 * y + 0.0145], -1),
        np.interp(y, [-long / 2, -long / 4, long / 4, long / 2], [0.0155, 0.0145, 0.0105, 0.010]),
        16,
        flat=0.8,
    )
    face = transform(
        lathe(
            np.array([(0.0, 0.0), (0.0105, 0), (0.0105, 0.02), (0.0135, 0.024), (0.0145, 0.040), (0.0135, 0.043), (0, 0.043)]),
            28,
        ),
        TO_X,
    )
    claw = tube(
        np.array([(0.004, 0, 0), (-0.022, 0, 0), (-0.044, -0.008, 0), (-0.060, -0.022, 0)]),
        np.array([0.013, 0.012, 0.009, 0.004]),
        12,
    )
    eye = translate(box((0.026, 0.026, 0.029), 0.003), 0, 0, -0.0145)
    head = translate(merge(face, claw, eye), 0, long / 2 - 0.012, 0.0145)
    look = (
        materials.wood(rng, "ash" if rng.random() < 0.5 else "beech", size=256) if rng.random() < 0.6 else materials.rubber(rng)
    )
    parts = (Part("handle", stick, look), Part("head", head, materials.metal(rng, tone=120)))
    return ObjectModel(
        "hammer", "hammer", parts, along("handle", (0, -0.24 * long, 0.0145), 0.027), tip=(0.043, long / 2 - 0.012, 0.0145)
    )


def screwdriver(rng: np.random.Generator) -> ObjectModel:
    """A lying screwdriver, tip towards +y."""
    handle, shaft = rng.uniform(0.095, 0.11), rng.uniform(0.09, 0.13)
    profile = np.array(
        [
            (0, 0),
            (0.011, 0.002),
            (0.0145, 0.012),
            (0.0155, 0.45 * handle),
            (0.0125, 0.78 * handle),
            (0.0145, 0.92 * handle),
            (0.009, handle),
            (0, handle),
        ]
    )
    grip = lathe(profile, 24, repeat_u=2.0)
    rod = lathe(np.array([(0.0032, 0), (0.0032, shaft - 0.012), (0.0042, shaft - 0.008), (0.0022, shaft), (0, shaft)]), 12)
    shift = -(handle + shaft) / 2
    parts = (
        Part("handle", translate(transform(grip, LIE_Y), 0, shift, 0.0155), materials.ceramic(rng)),
        Part("shaft", translate(transform(rod, LIE_Y), 0, shift + handle, 0.0155), materials.metal(rng)),
    )
    at = (0, shift + 0.45 * handle, 0.0155)
    return ObjectModel(
        "screwdriver",
        "screwdriver",
        parts,
        (*along("handle", at, 0.030), *pinch("shaft", (0, shift + handle, 0.016), 0.02)),
        tip=(0.0, shift + handle + shaft, 0.0155),
    )


def drill(rng: np.random.Generator) -> ObjectModel:
    """A cordless drill standing on its battery, chuck towards +y."""
    shell, dark = materials.ceramic(rng), materials.plastic(rng, (44, 44, 46))
    battery = box((0.070, 0.105, 0.045), 0.006, uv_per_m=9)
    z = np.linspace(0.04, 0.15, 10)
    handle = tube(np.stack([0 * z, -0.004 + 0.10 * (z - 0.1), z], -1), np.full(10, 0.0185), 18, flat=1.25, up=(0, 1, 0))
    body = lathe(np.array([(0, 0), (0.026, 0.002), (0.030, 0.02), (0.030, 0.10), (0.026, 0.135), (0, 0.136)]), 32, repeat_u=2)
    chuck = lathe(np.array([(0.021, 0), (0.021, 0.02), (0.017, 0.04), (0.008, 0.05), (0, 0.05)]), 24)
    bit = lathe(np.array([(0.003, 0), (0.003, 0.05), (0, 0.058)]), 10)
    front = translate(merge(transform(chuck, LIE_Y), translate(transform(bit, LIE_Y), 0, 0.045)), 0, 0.066, 0.172)
    trigger = translate(box((0.014, 0.016, 0.028), 0.003), 0, 0.024, 0.112)
    parts = (
        Part("body", translate(transform(body, LIE_Y), 0, -0.068, 0.172), shell),
        Part("battery", battery, dark),
        Part("handle", handle, dark),
        Part("chuck", front, materials.metal(rng, tone=120)),
        Part("trigger", trigger, materials.plastic(rng)),
    )
    grips = (*with_mirror(rod("handle", (0.0, -0.004, 0.098), UP, (-0.55, 0.83, 0.0), 0.038)), *over("body", 0.030, 0.19))
    return ObjectModel("drill", "drill", parts, grips, tip=(0.0, 0.17, 0.172))


def wrench(rng: np.random.Generator) -> ObjectModel:
    """A lying open-ended spanner, jaw towards +y."""
    long, wide = rng.uniform(0.17, 0.22), rng.uniform(0.009, 0.012)
    bar = translate(box((2 * wide, long - 0.03, 0.007), 0.002, uv_per_m=6), 0, -0.01, 0.0)
    jaw_at = np.linspace(0.35, 2 * np.pi - 0.35, 22) + np.pi / 2
    ring = np.stack([0.0145 * np.cos(jaw_at), 0.0145 * np.sin(jaw_at), 0 * jaw_at + 0.0055], -1)
    jaw = tube(ring, np.full(22, 0.0068), 10)
    end_at = np.linspace(0, 2 * np.pi, 23)
    end = tube(np.stack([0.0125 * np.cos(end_at), 0.0125 * np.sin(end_at), 0 * end_at + 0.0055], -1), np.full(23, 0.0052), 10)
    body = merge(bar, translate(jaw, 0, long / 2 - 0.012), translate(end, 0, -long / 2 + 0.006))
    return ObjectModel(
        "wrench",
        "wrench",
        (Part("wrench", body, materials.metal(rng)),),
        pinch("handle", (0, -0.15 * long, 0.006), 0.02),
        tip=(0.0, long / 2, 0.005),
    )


def saw(rng: np.random.Generator) -> ObjectModel:
    """A small hand saw lying flat, blade towards +y."""
    long = rng.uniform(0.22, 0.28)
    teeth = [(0.0 if k % 2 else 0.0035, long * k / 60) for k in range(61)]
    outline = np.array([(0.075, 0.0), (0.042, long), *[(-t, y) for t, y in teeth[::-1]]])
    blade = translate(extrude(outline, 0.0018, uv_per_m=5), -0.035, 0.0, 0.0095)
    a = np.linspace(0, 2 * np.pi, 25)
    loop = tube(
        np.stack([0.004 + 0.042 * np.cos(a), -0.045 + 0.048 * np.sin(a), 0 * a + 0.0105], -1), np.full(25, 0.0112), 14, flat=0.9
    )
    shift = -long / 2 + 0.045
    parts = (
        Part("blade", translate(blade, 0, shift), materials.metal(rng, tone=170)),
        Part("handle", translate(loop, 0, shift), materials.wood(rng, size=256)),
    )
    return ObjectModel(
        "saw", "saw", parts, pinch("handle", (0.0, shift - 0.089, 0.0105), 0.024), tip=(-0.03, shift + 0.6 * long, 0.01)
    )


def toolbox(rng: np.random.Generator) -> ObjectModel:
    """A metal box with a lid hinged at the back and a handle on the lid."""
    w, d, h = rng.uniform(0.22, 0.26), rng.uniform(0.12, 0.15), rng.uniform(0.07, 0.09)
    paint, inside = materials.plastic(rng, size=256), materials.plastic(rng, (60, 60, 64))
    wall = 0.003
    shell = merge(
        box((w, d, wall), 0.0),
        translate(box((w, wall, h), 0.0006), 0, d / 2 - wall / 2),
        translate(box((w, wall, h), 0.0006), 0, -d / 2 + wall / 2),
        translate(box((wall, d, h), 0.0006), w / 2 - wall / 2),
        translate(box((wall, d, h), 0.0006), -w / 2 + wall / 2),
    )
    tray = translate(box((w - 0.012, d - 0.012, 0.02), 0.001, uv_per_m=5), 0, 0, wall)
    lid = translate(box((w + 0.004, d + 0.004, 0.022), 0.004, uv_per_m=4), 0, 0, h)
    t = np.linspace(0, np.pi, 13)
    handle = tube(np.stack([0.055 * np.cos(t), 0 * t, h + 0.018 + 0.036 * np.sin(t) ** 0.5], -1), 0.0065, 12, up=(0, 1, 0))
    catches = merge(*[translate(box((0.022, 0.006, 0.03), 0.001), x, -d / 2 - 0.003, h - 0.014) for x in (-w / 3, w / 3)])
    parts = (
        Part("body", shell, paint),
        Part("tray", tray, inside),
        Part("catches", catches, materials.metal(rng)),
        Part("lid", lid, materials.plastic(rng, size=256), moving=True),
        Part("handle", handle, materials.rubber(rng), moving=True),
    )
    top = h + 0.054
    grips = (
        *pinch("lid", (0.0, -d / 2, h + 0.02), 0.02, moving=True),
        *sides("body", w / 2, 0.6 * h),
        *edge("side", (w / 2, 0.0, h * 0.9), 0.01),
        *with_mirror(rod("handle", (0.0, 0.0, top - 0.006), LEFT, (0.0, 0.15, -1.0), 0.013, moving=True)),
    )
    return ObjectModel(
        "toolbox", "toolbox", parts, grips, Joint("hinge", (0, d / 2, h), (-1, 0, 0), 0.0, 1.7), opening=(0.0, 0.0, h)
    )


def glue(rng: np.random.Generator) -> ObjectModel:
    """A glue bottle with a pointed nozzle."""
    r, h = rng.uniform(0.024, 0.030), rng.uniform(0.12, 0.15)
    body = lathe(np.array([(0, 0), (r - 0.003, 0), (r, 0.004), (r, 0.8 * h), (0.5 * r, 0.9 * h)]))
    wrap = lathe(np.array([(r + 0.0005, 0.1 * h), (r + 0.0005, 0.72 * h)]))
    tip = lathe(
        np.array([(0.55 * r, 0.88 * h), (0.5 * r, 0.95 * h), (0.2 * r, 1.0 * h), (0.12 * r, 1.2 * h), (0, 1.21 * h)]), 24
    )
    parts = (
        Part("body", body, materials.plastic(rng)),
        Part("label", wrap, materials.label(rng, repeat=int(rng.integers(1, 3)))),
        Part("tip", tip, materials.plastic(rng)),
    )
    return ObjectModel(
        "glue",
        "glue",
        parts,
        (*around("body", r, 0.45 * h), *over("tip", 0.5 * r, 0.95 * h)),
        spins=True,
        opening=(0.0, 0.0, 1.21 * h),
    )


def block(rng: np.random.Generator) -> ObjectModel:
    """A block of wood with saw marks and a screw in its top."""
    w, d, h = rng.uniform(0.07, 0.09), rng.uniform(0.11, 0.16), rng.uniform(0.05, 0.065)
    screw = translate(lathe(np.array([(0.0045, 0), (0.0045, 0.002), (0.002, 0.0035), (0, 0.0035)]), 16), 0.0, 0.02, h)
    parts = (
        Part("block", box((w, d, h), 0.002, uv_per_m=5), materials.wood(rng, "pine" if rng.random() < 0.5 else None)),
        Part("screw", screw, materials.metal(rng)),
    )
    return ObjectModel(
        "wood", "wood", parts, (*sides("body", w / 2, 0.6 * h, back=-0.02), *edge("edge", (w / 2, -0.02, h * 0.8), 0.02))
    )


def paint(rng: np.random.Generator) -> ObjectModel:
    """A paint tin with a wire handle and a label."""
    r, h = rng.uniform(0.042, 0.050), rng.uniform(0.095, 0.12)
    steel = lathe(
        np.array(
            [
                (0, 0),
                (r, 0),
                (r + 0.001, 0.004),
                (r - 0.001, 0.007),
                (r - 0.001, h - 0.006),
                (r + 0.002, h - 0.003),
                (r, h),
                (r - 0.006, h - 0.002),
                (0, h - 0.002),
            ]
        ),
        48,
    )
    wrap = lathe(np.array([(r - 0.0002, 0.012), (r - 0.0002, h - 0.014)]))
    t = np.linspace(0, np.pi, 17)
    wire = tube(np.stack([(r + 0.004) * np.cos(t), -(r + 0.006) * np.sin(t), 0.72 * h - 0.03 * np.sin(t)], -1), 0.0018, 8)
    parts = (
        Part("steel", steel, materials.metal(rng)),
        Part("label", wrap, materials.label(rng, repeat=2)),
        Part("wire", wire, materials.metal(rng)),
    )
    return ObjectModel("paint", "paint", parts, (*around("body", r, 0.5 * h), *over("rim", r, 0.94 * h)), opening=(0.0, 0.0, h))


BUILDERS = {
    "hammer": hammer,
    "screwdriver": screwdriver,
    "drill": drill,
    "wrench": wrench,
    "saw": saw,
    "toolbox": toolbox,
    "glue": glue,
    "wood": block,
    "paint": paint,
}
