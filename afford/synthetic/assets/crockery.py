"""Tableware and kitchen tools: mug, bowl, plate, spoon, knife, spatula, chopping board."""

from __future__ import annotations

import numpy as np

from afford.render import materials
from afford.render.mesh import merge, transform, translate
from afford.render.solids import box, extrude, lathe, tube
from afford.synthetic.assets.object_model import LEFT, UP, ObjectModel, Part, along, around, edge, mirror_grip, over, pinch, rod


def mug(rng: np.random.Generator) -> ObjectModel:
    """A cup with a handle to the right (+x)."""
    r, h, wall = rng.uniform(0.037, 0.045), rng.uniform(0.085, 0.105), 0.0035
    flare = rng.uniform(-0.004, 0.006)
    outer = [(0, 0), (r * 0.72, 0), (r - 0.005, 0.003), (r, 0.010), (r + flare, h - 0.002), (r + flare - wall / 2, h)]
    inner = [(r + flare - wall, h - 0.002), (r - wall, 0.012), (r - wall - 0.006, 0.006), (0, 0.006)]
    glaze = materials.ceramic(rng)
    body = lathe(np.array(outer), repeat_u=1.0)
    inside = lathe(np.array([outer[-1], *inner]))
    plain = materials.plastic(rng, (228, 224, 214)) if rng.random() < 0.6 else materials.plastic(rng)
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13)
    path = np.stack([r - 0.003 + 0.031 * np.cos(turn), np.zeros(13), h * 0.5 + 0.32 * h * np.sin(turn)], -1)
    handle = tube(path, 0.0056, 10, up=(0, 1, 0), flat=1.35)
    bow = (r + 0.026, 0.0, h * 0.5)
    right = rod("handle", bow, UP, LEFT, 0.012, lean_deg=-8.0)
    turned = rod("handle", (-bow[0], 0.0, bow[2]), UP, LEFT, 0.012, lean_deg=-8.0)
    left = mirror_grip(turned)
    grips = (*around("body", r, h * 0.52), right, left, *over("rim", r, h * 0.92))
    parts = (Part("body", body, glaze), Part("inside", inside, plain), Part("handle", handle, plain))
    return ObjectModel("mug", "mug", parts, grips, opening=(0.0, 0.0, h))


def bowl(rng: np.random.Generator) -> ObjectModel:
    """An open bowl."""
    r, h = rng.uniform(0.062, 0.085), rng.uniform(0.048, 0.065)
    s = np.linspace(0, 1, 12)
    curve = np.stack([0.4 * r + 0.6 * r * np.sin(s * np.pi / 2), 0.006 + (h - 0.006) * (1 - np.cos(s * np.pi / 2)) ** 0.9], -1)
    outer = lathe(np.concatenate([[(0, 0.002), (0.36 * r, 0), (0.4 * r, 0.001)], curve]), 56, repeat_u=2.0)
    inner = lathe(np.concatenate([[curve[-1]], curve[::-1] - [0.004, -0.001], [(0, 0.010)]]), 56, repeat_u=2.0)
    parts = (Part("outside", outer, materials.ceramic(rng)), Part("inside", inner, materials.ceramic(rng)))
    return ObjectModel(
        "bowl",
        "bowl",
        parts,
        (*edge("rim", (r, 0, h), 0.01), *edge("edge", (r, 0, h), 0.01)),
        spins=True,
        opening=(0.0, 0.0, h),
    )


def plate(rng: np.random.Generator) -> ObjectModel:
    """A dinner plate."""
    r = rng.uniform(0.095, 0.125)
    top = [(0, 0.006), (0.6 * r, 0.006), (0.66 * r, 0.009), (0.97 * r, 0.020), (r, 0.021)]
    under = [(0, 0.0), (0.55 * r, 0.0), (0.62 * r, 0.003), (0.98 * r, 0.016), (r, 0.0205)]
    upper = lathe(np.array(top[::-1]), 64, repeat_u=4.0)
    parts = (
        Part("top", upper, materials.ceramic(rng)),
        Part("bottom", lathe(np.array(under), 64), materials.plastic(rng, (226, 222, 214))),
    )
    return ObjectModel("plate", "plate", parts, edge("edge", (r, 0, 0.020), 0.008), spins=True)


def spoon(rng: np.random.Generator) -> ObjectModel:
    """A long cooking spoon lying on the table, handle towards -y."""
    length, wood = rng.uniform(0.20, 0.27), rng.random() < 0.5
    y = np.linspace(-length / 2, length / 2 - 0.05, 18)
    lift = 0.0075 + 0.004 * np.sin(np.linspace(0, np.pi, 18))
    stick = tube(np.stack([0 * y, y, lift], -1), np.interp(y, [-length / 2, 0, length / 2], [0.0072, 0.0055, 0.0050]), 12)
    a = np.linspace(0, 0.5 * np.pi, 7)
    cup = lathe(
        np.concatenate(
            [
                np.stack([0.021 * np.sin(a), -0.010 * np.cos(a)], -1),
                np.stack([0.019 * np.sin(a), -0.0075 * np.cos(a)], -1)[::-1],
            ]
        ),
        28,
    )
    scale = np.diag([1.0, 1.45, 1.0, 1.0])
    head = translate(transform(cup, scale), 0, length / 2 - 0.028, 0.0115)
    look = materials.wood(rng, size=256) if wood else materials.metal(rng)
    return ObjectModel(
        "spoon",
        "spoon",
        (Part("spoon", merge(stick, head), look),),
        pinch("handle", (0, -0.22 * length, 0.010), 0.014),
        tip=(0.0, length / 2 - 0.01, 0.004),
    )


def knife(rng: np.random.Generator) -> ObjectModel:
    """A kitchen knife lying flat, edge towards +x, handle towards -y."""
    blade, handle, deep = rng.uniform(0.15, 0.19), rng.uniform(0.105, 0.12), rng.uniform(0.034, 0.046)
    s = np.linspace(0, 1, 12)
    cut = np.stack([deep * (1 - 0.08 * s - 0.92 * s**4), blade * s], -1)
    outline = np.concatenate([[(0.0, 0.0)], cut, [(0.0, blade * 0.94)]])
    steel = translate(extrude(outline, 0.0022, uv_per_m=6), -deep * 0.35, 0.0, 0.0085)
    y = np.linspace(-handle, 0.004, 14)
    thick = 0.0125 + 0.0015 * np.sin(np.linspace(0, 2.2 * np.pi, 14))
    grip = tube(np.stack([0 * y - 0.002, y, 0 * y + 0.0096], -1), thick, 16, flat=0.72, repeat=(1, 1))
    look = materials.wood(rng, size=256) if rng.random() < 0.5 else materials.plastic(rng, (46, 44, 44))
    rivets = [
        translate(lathe(np.array([(0, 0.0), (0.0035, 0.0), (0.0032, 0.001), (0, 0.0012)]), 12), -0.002, -handle * f, 0.0180)
        for f in (0.25, 0.5, 0.75)
    ]
    shift = (handle - blade) / 2
    parts = (
        Part("blade", translate(steel, 0, shift), materials.metal(rng, tone=185)),
        Part("handle", translate(grip, 0, shift), look),
        Part("rivets", translate(merge(*rivets), 0, shift), materials.metal(rng)),
    )
    at = (0.0, shift - 0.45 * handle, 0.010)
    return ObjectModel(
        "knife",
        "knife",
        parts,
        (*pinch("handle", at, 0.024), *along("handle", at, 0.020, tilt_deg=55.0)),
        tip=(deep * 0.5, shift + blade * 0.8, 0.0096),
    )


def spatula(rng: np.random.Generator) -> ObjectModel:
    """A turner with a slotted blade, handle towards -y."""
    stick = rng.uniform(0.16, 0.19)
    y = np.linspace(-stick, 0.0, 12)
    bend = 0.010 + 0.012 * np.sin(np.linspace(0, np.pi, 12)) ** 2
    handle = tube(np.stack([0 * y, y, bend], -1), np.linspace(0.009, 0.0055, 12), 12, flat=0.7)
    bars = [translate(box((0.011, 0.075, 0.0022), 0.0006, uv_per_m=8), x, 0.052, 0.005) for x in (-0.027, -0.009, 0.009, 0.027)]
    rails = [translate(box((0.066, 0.013, 0.0022), 0.0006, uv_per_m=8), 0, v, 0.005) for v in (0.014, 0.090)]
    neck = tube(np.array([(0, -0.004, 0.0095), (0, 0.006, 0.008), (0, 0.018, 0.006)]), 0.005, 10)
    shift = (stick - 0.095) / 2
    blade = materials.metal(rng) if rng.random() < 0.5 else materials.plastic(rng)
    parts = (
        Part("handle", translate(handle, 0, shift), materials.plastic(rng)),
        Part("blade", translate(merge(*bars, *rails, neck), 0, shift), blade),
    )
    return ObjectModel(
        "spatula", "spatula", parts, pinch("handle", (0, shift - 0.62 * stick, 0.014), 0.016), tip=(0.0, shift + 0.085, 0.005)
    )


def board(rng: np.random.Generator) -> ObjectModel:
    """A chopping board with a hanging hole."""
    wide, long, thick = rng.uniform(0.20, 0.25), rng.uniform(0.28, 0.33), rng.uniform(0.014, 0.020)
    slab = box((wide, long, thick), 0.004, uv_per_m=3.2)
    ring = lathe(np.array([(0.0, 0.0), (0.011, 0.0), (0.011, 0.0004), (0, 0.0005)]), 20)
    hole = translate(ring, 0, -0.42 * long, thick)
    plank = materials.wood(rng, planks=int(rng.integers(2, 6)))
    parts = (Part("board", slab, plank), Part("hole", hole, materials.plastic(rng, (30, 26, 22))))
    return ObjectModel("board", "board:chopping", parts, edge("edge", (wide / 2, -0.02, thick), thick), opening=None)


BUILDERS = {"mug": mug, "bowl": bowl, "plate": plate, "spoon": spoon, "knife": knife, "spatula": spatula, "board": board}
