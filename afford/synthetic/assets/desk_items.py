"""Desk objects: stapler, scissors, tape, book, laptop, pen cup, phone."""

from __future__ import annotations

import cv2
import numpy as np

from afford.render import materials
from afford.render.mesh import merge, transform, translate
from afford.render.patterns import flat, image
from afford.render.scene import Material
from afford.render.solids import box, extrude, lathe, tube
from afford.synthetic.assets.object_model import Joint, ObjectModel, Part, along, around, edge, over, pinch, sides


def stapler(rng: np.random.Generator) -> ObjectModel:
    """A stapler, mouth towards +y, whose top arm is hinged at the back end."""
    long = rng.uniform(0.13, 0.16)
    base = box((0.036, long, 0.012), 0.003, uv_per_m=8)
    y = np.linspace(-long / 2, long / 2 - 0.004, 12)
    arm = tube(
        np.stack([0 * y, y, 0.031 + 0.006 * np.sin(np.linspace(0, np.pi, 12))], -1),
        np.interp(y, [-long / 2, 0, long / 2], [0.0165, 0.0185, 0.0150]),
        18,
        flat=0.8,
    )
    rail = translate(box((0.015, long * 0.92, 0.010), 0.001, uv_per_m=8), 0, 0, 0.014)
    parts = (
        Part("base", base, materials.plastic(rng, (50, 50, 54))),
        Part("rail", rail, materials.metal(rng), moving=True),
        Part("arm", arm, materials.ceramic(rng), moving=True),
    )
    grips = (*along("body", (0.0, -0.012, 0.030), 0.034, tilt_deg=60.0), *pinch("arm", (0.0, 0.0, 0.030), 0.034))
    return ObjectModel(
        "stapler",
        "stapler",
        parts,
        grips,
        Joint("hinge", (0, -long / 2, 0.014), (1, 0, 0), 0.0, 0.5),
        tip=(0.0, long / 2, 0.014),
    )


def scissors(rng: np.random.Generator) -> ObjectModel:
    """Lying scissors, points towards +y, with one moving half."""
    long = rng.uniform(0.16, 0.20)
    steel, hue = materials.metal(rng, tone=180), materials.plastic(rng)
    halves = []
    for sign in (1.0, -1.0):
        blade = extrude(np.array([(0.0, 0.0), (sign * 0.009, 0.0), (0.0, 0.58 * long)])[:: int(sign)], 0.002, uv_per_m=6)
        a = np.linspace(0, 2 * np.pi, 23)
        eye = tube(
            np.stack([-sign * 0.021 + 0.016 * np.cos(a), -0.30 * long + 0.022 * np.sin(a), 0 * a + 0.006], -1),
            np.full(23, 0.0052),
            10,
        )
        arm = tube(
            np.array([(0, 0.0, 0.005), (-sign * 0.006, -0.10 * long, 0.0055), (-sign * 0.016, -0.19 * long, 0.006)]),
            np.array([0.006, 0.0055, 0.005]),
            10,
        )
        halves.append((translate(blade, 0, 0, 0.004 + 0.002 * (sign < 0)), merge(eye, arm)))
    pin = translate(lathe(np.array([(0.005, 0), (0.005, 0.003), (0, 0.004)]), 16), 0, 0.0, 0.007)
    parts = (
        Part("blade", halves[0][0], steel),
        Part("handle", halves[0][1], hue),
        Part("pin", pin, materials.metal(rng)),
        Part("blade_2", halves[1][0], steel, moving=True),
        Part("handle_2", halves[1][1], hue, moving=True),
    )
    return ObjectModel(
        "scissors",
        "scissors",
        parts,
        pinch("handle", (0.0, -0.2 * long, 0.008), 0.03),
        Joint("hinge", (0, 0, 0), (0, 0, 1), 0.0, 0.7),
        tip=(0.0, 0.5 * long, 0.005),
    )


def tape(rng: np.random.Generator) -> ObjectModel:
    """A roll of parcel tape standing on its flat side."""
    r, h = rng.uniform(0.042, 0.052), rng.uniform(0.035, 0.05)
    hole = r * 0.72
    roll = lathe(np.array([(hole + 0.003, 0), (r, 0), (r, h), (hole + 0.003, h)]), 48, repeat_u=6)
    core = lathe(np.array([(hole + 0.003, h), (hole, h), (hole, 0.0), (hole + 0.003, 0.0)]), 48, repeat_u=3)
    parts = (Part("roll", roll, materials.ceramic(rng)), Part("core", core, materials.label(rng)))
    return ObjectModel("tape", "tape", parts, (*over("rim", r, h), *around("body", r, 0.6 * h)), spins=True)


def book(rng: np.random.Generator) -> ObjectModel:
    """A lying book, spine to the left, whose cover opens about the spine."""
    w, d, h = rng.uniform(0.13, 0.17), rng.uniform(0.19, 0.23), rng.uniform(0.018, 0.032)
    cover, text = materials.carton(rng), materials.paper(rng)
    leaves = translate(box((w - 0.008, d - 0.010, h - 0.008), 0.0), 0, 0, 0.003)
    top_page = translate(box((w - 0.010, d - 0.012, 0.0008), 0.0), 0, 0, h - 0.0052)
    back = merge(box((w, d, 0.003), 0.0006), translate(box((0.003, d, h), 0.0006), -w / 2 - 0.001))
    front = translate(box((w, d, 0.003), 0.0006), 0, 0, h - 0.003)
    parts = (
        Part("leaves", leaves, materials.pages(rng)),
        Part("page", top_page, text),
        Part("back", back, materials.leather(rng)),
        Part("cover", front, cover, moving=True),
    )
    grips = (
        *edge("edge", (w / 2, -0.02, h), h),
        *sides("side", w / 2, h * 0.5),
        *pinch("cover", (0.42 * w, -d * 0.25, h), 0.003, moving=True),
    )
    return ObjectModel("book", "book", parts, grips, Joint("hinge", (-w / 2, 0, h - 0.003), (0, -1, 0), 0.0, 2.6))


def laptop(rng: np.random.Generator) -> ObjectModel:
    """A closed laptop whose screen opens about the back edge."""
    w, d = rng.uniform(0.27, 0.31), rng.uniform(0.19, 0.22)
    shell = materials.metal(rng) if rng.random() < 0.5 else materials.plastic(rng, (70, 72, 78))
    base = box((w, d, 0.012), 0.003, uv_per_m=4)
    keys = translate(box((w - 0.03, d * 0.55, 0.0006), 0.0), 0, 0.02, 0.0120)
    lid = translate(box((w, d, 0.007), 0.002, uv_per_m=4), 0, 0, 0.0135)
    screen = translate(transform(box((w - 0.02, d - 0.02, 0.0005), 0.0), np.diag([1.0, 1.0, -1.0, 1.0])), 0, 0, 0.0134)
    badge = translate(lathe(np.array([(0.0, 0.0), (0.018, 0), (0.018, 0.0004), (0, 0.0005)]), 24), 0, 0, 0.0205)
    parts = (
        Part("base", base, shell),
        Part("keys", keys, _keyboard(rng)),
        Part("lid", lid, shell, moving=True),
        Part("screen", screen, materials.paper(rng), moving=True),
        Part("badge", badge, materials.ceramic(rng), moving=True),
    )
    grips = (
        *pinch("screen", (0.0, -d / 2, 0.018), 0.008, moving=True),
        *edge("edge", (w / 2, -0.03, 0.018), 0.02),
        *sides("side", w / 2, 0.012),
    )
    return ObjectModel("laptop", "laptop", parts, grips, Joint("hinge", (0, d / 2, 0.013), (-1, 0, 0), 0.0, 1.95))


def _keyboard(rng: np.random.Generator, size: int = 256) -> Material:
    canvas = image(flat(rng, size, (40, 40, 44), 3.0))
    for row in range(5):
        for column in range(13):
            x, y = int((column + 0.1) * size / 13), int((row + 0.1) * size / 5)
            cv2.rectangle(canvas, (x, y), (x + size // 17, y + size // 7), (92, 92, 98), -1)
            cv2.circle(canvas, (x + 7, y + 12), 3, (214, 214, 214), -1)
    return Material(canvas, specular=0.03, roughness=0.6)


def cup(rng: np.random.Generator) -> ObjectModel:
    """A pen cup with pens in it."""
    r, h = rng.uniform(0.036, 0.042), rng.uniform(0.09, 0.11)
    wall = lathe(np.array([(0, 0), (r, 0), (r, h), (r - 0.0025, h), (r - 0.0025, 0.006), (0, 0.006)]))
    pens = []
    for turn in rng.uniform(0, 2 * np.pi) + np.arange(4) * 1.57:
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        line = np.array(
            [out * -0.010 + [0, 0, 0.006], out * 0.012 + [0, 0, 0.07], out * (r - 0.012) + [0, 0, h + rng.uniform(0.02, 0.05)]]
        )
        pens.append(tube(line, 0.0042, 8))
    parts = (
        Part("cup", wall, materials.ceramic(rng)),
        Part("pens", merge(*pens[:2]), materials.plastic(rng)),
        Part("pencils", merge(*pens[2:]), materials.plastic(rng)),
    )
    return ObjectModel("cup", "cup", parts, (*around("body", r, 0.5 * h), *edge("rim", (r, 0, h), 0.006)))


def phone(rng: np.random.Generator) -> ObjectModel:
    """A mobile phone lying face up."""
    w, d = rng.uniform(0.070, 0.078), rng.uniform(0.145, 0.160)
    body = box((w, d, 0.009), 0.003, uv_per_m=10)
    glass = translate(box((w - 0.005, d - 0.006, 0.0006), 0.0), 0, 0, 0.009)
    parts = (Part("body", body, materials.plastic(rng)), Part("screen", glass, materials.carton(rng)))
    return ObjectModel(
        "phone", "phone", parts, (*edge("edge", (w / 2, -0.02, 0.008), 0.010), *pinch("side", (0.0, 0.0, 0.006), w))
    )


BUILDERS = {"stapler": stapler, "scissors": scissors, "tape": tape, "book": book, "laptop": laptop, "cup": cup, "phone": phone}
