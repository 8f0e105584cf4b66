"""Packages: cereal box with a lid flap, drink carton, can."""

from __future__ import annotations

import numpy as np

from afford.render import materials
from afford.render.mesh import merge, moved, transform
from afford.render.solids import box, extrude, lathe
from afford.synthetic.things.asset import Joint, ObjectModel, Part
from afford.synthetic.things.grips import around, over, pinch, sides


def package(rng: np.random.Generator) -> ObjectModel:
    """A printed cardboard box; its top is a flap on a hinge at the back."""
    w, d, h = rng.uniform(0.10, 0.15), rng.uniform(0.045, 0.062), rng.uniform(0.14, 0.20)
    print_ = materials.carton(rng)
    body = box((w, d, h - 0.002), 0.0012)
    flap = moved(box((w, d, 0.002), 0.0006), 0, 0, h - 0.002)
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
    fin = moved(box((w, 0.004, 0.016), 0.0005), 0, 0, h + 0.026)
    cap = lathe(np.array([(0.0125, 0), (0.0125, 0.014), (0.011, 0.016), (0, 0.016)]), 20)
    parts = (
        Part("body", merge(body, transform(gable, T), fin), side),
        Part("cap", moved(cap, 0, -w / 4, h + 0.008), materials.plastic(rng)),
    )
    return ObjectModel(
        "carton",
        "carton",
        parts,
        (*around("body", w / 2, 0.5 * h), *around("side", w / 2, 0.6 * h)),
        opening=(0.0, -w / 4, h + 0.024),
    )


def can(rng: np.random.Generator) -> ObjectModel:
    """A tin with a printed wrapper."""
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


BUILDERS = {"box": package, "carton": carton, "can": can}
