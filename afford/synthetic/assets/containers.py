"""Containers: kettle, pan, jar, bottles, cardboard box, drink carton, can."""

from __future__ import annotations

import numpy as np

from afford.render import materials
from afford.render.mesh import merge, transform, translate
from afford.render.solids import box, extrude, lathe, tube
from afford.synthetic.assets.object_model import UP, Joint, ObjectModel, Part, along, around, over, pinch, rod, sides, with_mirror


def bottle(rng: np.random.Generator) -> ObjectModel:
    """A glass-coloured bottle with a printed label and a cap."""
    r, h = rng.uniform(0.030, 0.038), rng.uniform(0.20, 0.26)
    shoulder, neck = rng.uniform(0.56, 0.66) * h, rng.uniform(0.0125, 0.0155)
    s = np.linspace(0, 1, 9)
    curve = np.stack([neck + (r - neck) * (0.5 + 0.5 * np.cos(np.pi * s)), shoulder + (0.84 * h - shoulder) * s], -1)
    glass = lathe(np.concatenate([[(0, 0.003), (r - 0.006, 0), (r, 0.006)], curve, [(neck, 0.93 * h)]]), repeat_u=2.0)
    low, high = 0.12 * h, shoulder * 0.93
    wrap = lathe(np.array([(r + 0.0006, low), (r + 0.0006, high)]))
    cap = lathe(np.array([(neck + 0.003, 0.91 * h), (neck + 0.003, h - 0.002), (neck + 0.001, h), (0, h)]), 24)
    parts = (
        Part("glass", glass, materials.plastic(rng)),
        Part("label", wrap, materials.label(rng, repeat=int(rng.integers(1, 4)))),
        Part("cap", cap, materials.plastic(rng)),
    )
    grips = (*around("body", r, 0.42 * h), *around("neck", neck + 0.004, 0.80 * h))
    return ObjectModel("bottle", "bottle", parts, grips, spins=True, opening=(0.0, 0.0, h))


def water(rng: np.random.Generator) -> ObjectModel:
    """A drinking bottle of metal or plastic with a printed body."""
    r, h = rng.uniform(0.033, 0.038), rng.uniform(0.19, 0.23)
    body = lathe(np.array([(0, 0), (r - 0.004, 0), (r, 0.005), (r, 0.80 * h), (r * 0.72, 0.87 * h)]))
    lid = lathe(np.array([(r * 0.74, 0.86 * h), (r * 0.76, 0.97 * h), (r * 0.6, h), (0, h)]))
    parts = (Part("body", body, materials.ceramic(rng)), Part("lid", lid, materials.plastic(rng)))
    return ObjectModel(
        "water", "bottle", parts, (*around("body", r, 0.45 * h), *over("lid", 0.7 * r, h)), spins=True, opening=(0.0, 0.0, h)
    )


def kettle(rng: np.random.Generator) -> ObjectModel:
    """A kettle with a spout (+y), a handle at the back (-y) and a lid on a hinge."""
    r, h = rng.uniform(0.066, 0.078), rng.uniform(0.15, 0.18)
    body = lathe(np.array([(0, 0), (r, 0), (r + 0.003, 0.006), (r, 0.02), (0.78 * r, 0.9 * h), (0.70 * r, 0.94 * h)]), 56)
    base = lathe(np.array([(0, -0.0), (r + 0.008, 0.0), (r + 0.008, 0.010), (r, 0.012)]), 48)
    top = lathe(
        np.array([(0.72 * r, 0.935 * h), (0.6 * r, 0.965 * h), (0.16 * r, 0.985 * h), (0.14 * r, 1.05 * h), (0, 1.055 * h)]), 40
    )
    spout = tube(
        np.array([(0, 0.62 * r, 0.72 * h), (0, 1.05 * r, 0.84 * h), (0, 1.26 * r, 0.97 * h)]),
        np.array([0.026, 0.018, 0.012]),
        14,
    )
    s = np.linspace(0, 1, 12)
    arch = np.stack([0 * s, -(0.72 * r + 0.055 * np.sin(np.pi * s) ** 0.6 + 0.012 * (1 - s)), h * (0.20 + 0.74 * s)], -1)
    handle = tube(arch, 0.0115, 14, up=(1, 0, 0))
    shell = materials.metal(rng, tone=170) if rng.random() < 0.5 else materials.plastic(rng)
    dark = materials.plastic(rng, (40, 40, 44))
    parts = (
        Part("body", merge(body, spout), shell),
        Part("base", base, dark),
        Part("handle", handle, dark),
        Part("lid", top, dark, moving=True),
    )
    reach = 0.72 * r + 0.055
    grips = (
        *with_mirror(rod("handle", (0.0, -reach - 0.006, 0.60 * h), UP, (-0.45, 0.90, 0.0), 0.024, lean_deg=-12.0)),
        *over("lid", 0.14 * r + 0.004, 1.05 * h, moving=True),
    )
    joint = Joint("hinge", (0, -0.70 * r, 0.94 * h), (1, 0, 0), 0.0, 1.3)
    return ObjectModel("kettle", "kettle", parts, grips, joint, opening=(0.0, 1.26 * r, 0.97 * h))


def pan(rng: np.random.Generator) -> ObjectModel:
    """A frying pan, handle towards -y."""
    r, h, stick = rng.uniform(0.095, 0.125), rng.uniform(0.038, 0.05), rng.uniform(0.14, 0.17)
    outer = lathe(np.array([(0, 0), (0.82 * r, 0), (0.88 * r, 0.004), (r, h)]), 64, repeat_u=4.0)
    inner = lathe(np.array([(r, h), (r - 0.003, h), (0.86 * r, 0.007), (0.80 * r, 0.004), (0, 0.004)]), 64, repeat_u=4.0)
    y = np.linspace(-r - stick, -r + 0.008, 14)
    rise = h * 0.86 + 0.020 * np.sin(np.linspace(0.1, 0.5 * np.pi, 14))[::-1]
    handle = tube(
        np.stack([0 * y, y, rise], -1), np.interp(y, [-r - stick, -r - 0.05, -r], [0.0145, 0.0125, 0.0075]), 16, flat=0.68
    )
    coat = materials.metal(rng, tone=70)
    parts = (
        Part("outside", outer, materials.metal(rng, tone=110) if rng.random() < 0.5 else materials.plastic(rng)),
        Part("inside", inner, coat),
        Part("handle", handle, materials.plastic(rng, (44, 42, 42))),
    )
    middle = -r - 0.58 * stick
    height = float(np.interp(middle, y, rise))
    grips = along("handle", (0.0, middle, height), 0.024)
    return ObjectModel("pan", "pan", parts, grips, opening=(0.0, 0.0, h))


def jar(rng: np.random.Generator) -> ObjectModel:
    """A jar with a label and a lid that lifts off."""
    r, h = rng.uniform(0.036, 0.043), rng.uniform(0.10, 0.13)
    body = lathe(
        np.array(
            [
                (0, 0.002),
                (r - 0.005, 0),
                (r, 0.006),
                (r, 0.74 * h),
                (r * 0.86, 0.82 * h),
                (r * 0.86, 0.90 * h),
                (r * 0.84, 0.90 * h),
                (r * 0.84, 0.3 * h),
                (0, 0.3 * h),
            ]
        )
    )
    wrap = lathe(np.array([(r + 0.0006, 0.16 * h), (r + 0.0006, 0.66 * h)]))
    cap = [(r * 0.86, 0.85 * h), (r * 0.94, 0.85 * h), (r * 0.95, 0.98 * h), (r * 0.90, h), (0, h)]
    lid = lathe(np.array(cap), 40)
    under = lathe(np.array([(0, 0.93 * h), (r * 0.88, 0.93 * h), (r * 0.88, 0.85 * h)][::-1]), 40)
    parts = (
        Part("glass", body, materials.plastic(rng)),
        Part("label", wrap, materials.label(rng, repeat=int(rng.integers(1, 3)))),
        Part("lid", merge(lid, under), materials.ceramic(rng), moving=True),
    )
    grips = (*around("body", r, 0.42 * h), *over("lid", r * 0.95, 0.97 * h, moving=True))
    joint = Joint("free", (0, 0, 0.85 * h), (0, 0, 1), 0.0, 0.2)
    return ObjectModel("jar", "jar", parts, grips, joint, spins=True, opening=(0.0, 0.0, 0.9 * h))


def package(rng: np.random.Generator) -> ObjectModel:
    """A printed cardboard box whose top is a flap on a hinge at the back."""
    w, d, h = rng.uniform(0.10, 0.15), rng.uniform(0.045, 0.062), rng.uniform(0.14, 0.20)
    print_ = materials.carton(rng)
    body = box((w, d, h - 0.002), 0.0012)
    flap = translate(box((w, d, 0.002), 0.0006), 0, 0, h - 0.002)
    parts = (Part("body", body, print_), Part("flap", flap, materials.carton(rng), moving=True))
    joint = Joint("hinge", (0, d / 2, h - 0.001), (-1, 0, 0), 0.0, 1.9)
    grips = (
        *sides("side", w / 2, 0.5 * h),
        *sides("body", w / 2, 0.55 * h),
        *pinch("flap", (0, -d / 2, h), 0.004, moving=True),
    )
    return ObjectModel("box", "box", parts, grips, joint, opening=(0.0, 0.0, h))


def carton(rng: np.random.Generator) -> ObjectModel:
    """A drink carton with a gable top and a screw cap."""
    w, h = rng.uniform(0.062, 0.072), rng.uniform(0.17, 0.20)
    side = materials.carton(rng)
    body = box((w, w, h), 0.002)
    gable = extrude(np.array([(-w / 2, 0), (w / 2, 0), (0.004, 0.028), (-0.004, 0.028)]), w)
    T = np.array([[0, 0, 1, -w / 2], [1, 0, 0, 0], [0, 1, 0, h], [0, 0, 0, 1.0]])
    fin = translate(box((w, 0.004, 0.016), 0.0005), 0, 0, h + 0.026)
    cap = lathe(np.array([(0.0125, 0), (0.0125, 0.014), (0.011, 0.016), (0, 0.016)]), 20)
    parts = (
        Part("body", merge(body, transform(gable, T), fin), side),
        Part("cap", translate(cap, 0, -w / 4, h + 0.008), materials.plastic(rng)),
    )
    return ObjectModel(
        "carton",
        "carton",
        parts,
        (*around("body", w / 2, 0.5 * h), *around("side", w / 2, 0.6 * h)),
        opening=(0.0, -w / 4, h + 0.024),
    )


def can(rng: np.random.Generator) -> ObjectModel:
    """A tin can with a printed wrapper."""
    r, h = rng.uniform(0.033, 0.040), rng.uniform(0.09, 0.12)
    steel = lathe(
        np.array(
            [
                (0, 0.002),
                (r - 0.002, 0.002),
                (r - 0.001, 0),
                (r, 0.002),
                (r - 0.001, 0.005),
                (r - 0.001, h - 0.005),
                (r, h - 0.002),
                (r - 0.001, h),
                (r - 0.003, h - 0.003),
                (0.4 * r, h - 0.004),
                (0, h - 0.003),
            ]
        )
    )
    wrap = lathe(np.array([(r - 0.0004, 0.006), (r - 0.0004, h - 0.006)]))
    parts = (
        Part("steel", steel, materials.metal(rng)),
        Part("label", wrap, materials.label(rng, repeat=int(rng.integers(1, 4)))),
    )
    return ObjectModel(
        "can", "can", parts, (*around("body", r, 0.5 * h), *over("rim", r, 0.95 * h)), spins=True, opening=(0.0, 0.0, h)
    )


BUILDERS = {"bottle": bottle, "water": water, "kettle": kettle, "pan": pan, "jar": jar, "box": package, "carton": carton,
            "can": can}  # fmt: skip
