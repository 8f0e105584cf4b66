"""Manipulated objects by type, and the companion object that each tool is used on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from afford.render import materials
from afford.render.mesh import translate
from afford.render.solids import box, lathe, tube
from afford.synthetic.assets import crockery, kitchenware, library
from afford.synthetic.assets.object_model import ObjectModel, Part, along, around, over
from afford.synthetic.kitchens.trajectories import roll_grip
from schemas.interaction import OBJECT_TYPES

Builder = Callable[[np.random.Generator], ObjectModel]
FROM_ABOVE_DEG = {"hammer": -45.0, "knife": -30.0}
"""Rotation of a lying tool's grip about the tool, degrees, so that the palm faces sideways in the working pose."""


def ball(rng: np.random.Generator) -> ObjectModel:
    """A soft printed ball."""
    r = rng.uniform(0.034, 0.046)
    a = np.linspace(-np.pi / 2, np.pi / 2, 24)
    skin = lathe(np.stack([r * np.cos(a), r + r * np.sin(a)], -1), repeat_u=2.0)
    look = materials.ceramic(rng) if rng.random() < 0.6 else materials.plastic(rng)
    grips = (*over("top", r, 1.7 * r), *around("body", r, r))
    return ObjectModel("ball", "ball", (Part("body", skin, look),), grips, spins=True)


def sponge(rng: np.random.Generator) -> ObjectModel:
    """A washing-up sponge, scouring side up."""
    w, d, h = rng.uniform(0.095, 0.125), rng.uniform(0.060, 0.078), rng.uniform(0.028, 0.040)
    soft, rough = translate(box((w, d, 0.72 * h), 0.003), 0, 0, 0), translate(box((w, d, 0.28 * h), 0.002), 0, 0, 0.72 * h)
    tint = (236, 204, 84) if rng.random() < 0.4 else None
    parts = (Part("body", soft, materials.plastic(rng, tint)), Part("scourer", rough, materials.plastic(rng)))
    return ObjectModel("sponge", "sponge", parts, over("top", 0.5 * d, h))


def paint_brush(rng: np.random.Generator) -> ObjectModel:
    """A lying flat paint brush, bristles at +y."""
    stick, wide, hair = rng.uniform(0.12, 0.15), rng.uniform(0.034, 0.055), rng.uniform(0.048, 0.062)
    y = np.linspace(-stick, 0.0, 14)
    handle = tube(np.stack([0 * y, y, 0 * y + 0.009], -1), np.interp(y, [-stick, -0.5 * stick, 0], [0.008, 0.012, 0.010]), 14,
                  flat=0.7)  # fmt: skip
    ferrule = translate(box((wide, 0.032, 0.014), 0.002), 0, 0.012, 0.002)
    tuft = translate(box((0.97 * wide, hair, 0.015), 0.003), 0, 0.028 + hair / 2, 0.0015)
    shift = (stick - 0.028 - hair) / 2
    look = materials.wood(rng, size=256) if rng.random() < 0.5 else materials.plastic(rng)
    bristle = materials.plastic(rng, ((230, 222, 200), (52, 44, 40), (176, 132, 84))[rng.integers(3)])
    parts = (Part("handle", translate(handle, 0, shift), look), Part("ferrule", translate(ferrule, 0, shift), materials.metal(rng)),
             Part("bristles", translate(tuft, 0, shift), bristle))  # fmt: skip
    grips = along("handle", (0.0, shift - 0.45 * stick, 0.009), 0.018, tilt_deg=70.0)
    return ObjectModel("brush", "brush", parts, grips, tip=(0.0, shift + 0.026 + hair, 0.004))


def _tool(kind: str) -> Builder:
    def build(rng: np.random.Generator) -> ObjectModel:
        model = library.build(kind, rng)
        grips = [g for g in model.grips if g.kind == "handle_wrap"]
        turn = np.radians(FROM_ABOVE_DEG[kind])
        turned = tuple(roll_grip(g, turn if g.side == "right" else -turn, 0.012) for g in grips)
        return replace(model, grips=turned)

    return build


def _phone(rng: np.random.Generator) -> ObjectModel:
    """A smartphone with only its edge grip."""
    model = library.build("phone", rng)
    return replace(model, grips=tuple(g for g in model.grips if g.name == "edge"))


def _book(rng: np.random.Generator) -> ObjectModel:
    """A book that stays closed, with only its edge grip."""
    model = library.build("book", rng)
    parts = tuple(replace(part, moving=False) for part in model.parts)
    return replace(model, parts=parts, joint=None, grips=tuple(g for g in model.grips if g.name == "edge"))


BUILDERS: dict[str, Builder] = {
    "ball": ball,
    "book": _book,
    "bottle": lambda rng: library.build("bottle", rng),
    "brush": paint_brush,
    "can": lambda rng: library.build("can", rng),
    "cup": crockery.mug,
    "hammer": _tool("hammer"),
    "knife": _tool("knife"),
    "pitcher": kitchenware.jug,
    "smartphone": _phone,
    "sponge": sponge,
}


def build(object_type: str, seed: int) -> ObjectModel:
    """Build the object of a type from a seed. Raises KeyError with the known types."""
    if object_type not in BUILDERS:
        raise KeyError(f"InteractionSpec.object_type: expected one of {', '.join(OBJECT_TYPES)}, got {object_type!r}")
    return BUILDERS[object_type](np.random.default_rng([seed, OBJECT_TYPES.index(object_type)]))


def loaf(rng: np.random.Generator) -> tuple[Part, ...]:
    """A long loaf along x on a board, to be cut."""
    y = np.linspace(-0.08, 0.08, 22)
    r = 0.034 * np.sqrt(np.clip(1 - (y / 0.083) ** 2, 0.05, 1)) * rng.uniform(0.85, 1.1)
    crust = translate(tube(np.stack([y, 0 * y, 0 * y], -1), r, 18, flat=0.8), 0, 0, 0.038)
    board = box((0.19, 0.12, 0.012), 0.003, uv_per_m=4)
    tint = (int(rng.uniform(180, 205)), int(rng.uniform(125, 150)), int(rng.uniform(70, 95)))
    return (Part("board", board, materials.wood(rng, size=256)), Part("loaf", crust, materials.plastic(rng, tint, 256)))


def block(rng: np.random.Generator) -> tuple[Part, ...]:
    """A block of wood, to be hammered on."""
    size = (float(rng.uniform(0.09, 0.13)), float(rng.uniform(0.09, 0.12)), 0.05)
    return (Part("block", box(size, 0.003, uv_per_m=5), materials.wood(rng, "pine", 256)),)


def sheet(rng: np.random.Generator) -> tuple[Part, ...]:
    """A panel, to be painted on."""
    panel = box((float(rng.uniform(0.20, 0.27)), float(rng.uniform(0.15, 0.20)), 0.008), 0.001)
    return (Part("sheet", panel, materials.plastic(rng, (228, 226, 220), 128)),)


COMPANIONS: dict[str, Callable[[np.random.Generator], tuple[Part, ...]]] = {"knife": loaf, "hammer": block, "brush": sheet}
"""Companion object beside a tool. It is present for every affordance, so it does not reveal the action."""
CONTACT_HEIGHT_M = {"knife": 0.066, "hammer": 0.050, "brush": 0.008}
"""Height above the table at which the tool meets its companion, metres."""

COMPANION_OFFSET_M = {"knife": (-0.06, 0.135), "hammer": (-0.03, 0.125), "brush": (0.11, 0.0)}
"""Offset of the companion's middle from the tip of the tool: metres ahead, and to the side of the other hand."""
