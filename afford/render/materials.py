"""Random materials: wood, stone, laminate, tiles, metal, glaze, print, cloth, plastic, leather.

Each function draws from `rng`, so that every call gives another material.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from afford.render.patterns import FONTS, barcode, cloud, flat, grain, image, ramp, rgb, small_print, vivid, word, write
from afford.render.scene import Material

SPECIES = {
    "oak": [(196, 156, 104), (172, 128, 80), (140, 100, 60)],
    "walnut": [(122, 84, 58), (92, 60, 40), (64, 42, 30)],
    "pine": [(226, 190, 136), (208, 164, 106), (172, 122, 70)],
    "beech": [(216, 178, 138), (198, 154, 114), (176, 132, 96)],
    "cherry": [(186, 118, 78), (158, 92, 58), (126, 68, 42)],
    "ash": [(212, 196, 168), (190, 170, 138), (160, 138, 106)],
}


def wood(rng: np.random.Generator, species: str | None = None, size: int = 512, planks: int = 1) -> Material:
    """Wood with its grain along v (the image's y), in `planks` boards side by side."""
    name = species or list(SPECIES)[rng.integers(len(SPECIES))]
    rows = [_board(rng, size, SPECIES[name]) for _ in range(min(planks, 3))]
    out = np.zeros((size, size, 3), np.float32)
    cuts = np.linspace(0, size, planks + 1).astype(int)
    for k, (start, stop) in enumerate(pairwise(cuts)):
        shift = int(rng.integers(size))
        out[:, start:stop] = np.roll(rows[k % len(rows)], shift, 0)[:, : stop - start] * rng.uniform(0.9, 1.06)
        if planks > 1:
            out[:, start : start + 2] *= 0.45
    return Material(image(out), specular=0.04, roughness=float(rng.uniform(0.35, 0.6)), bump=0.3)


def _board(rng: np.random.Generator, size: int, stops: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """One board: growth rings cut lengthwise, with fibres and pores."""
    x = np.arange(size, dtype=np.float32)[None] / size
    bend = cloud(rng, size, 2.2, (1.0, 4.0))
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (rng.integers(5, 9) * x + 5.0 * (bend - 0.5)))
    fibre = cloud(rng, size, 0.9, (0.35, 9.0))
    pores = np.clip((cloud(rng, size, 0.55, (0.25, 6.0)) - 0.72) * 4, 0, 1)
    tone = 0.42 * rings**1.5 + 0.5 * fibre + 0.35 * (cloud(rng, size, 1.8) - 0.5)
    return ramp(tone, stops) * (1 - 0.35 * pores[..., None]) + grain(rng, size)[..., None] * 2.0


def marble(rng: np.random.Generator, size: int = 512) -> Material:
    """Stone with veins, light or dark."""
    warp = cloud(rng, size, 1.8)
    vein = np.abs(cloud(rng, size, 1.7) - 0.5 + 0.25 * (warp - 0.5))
    fine = np.abs(cloud(rng, size, 1.3) - 0.5)
    mark = np.exp(-((vein / 0.02) ** 2)) * 0.8 + np.exp(-((fine / 0.012) ** 2)) * 0.25
    dark = rng.random() < 0.35
    base, ink = ((58, 60, 64), (150, 148, 142)) if dark else ((226, 222, 214), (128, 124, 122))
    colour = flat(rng, size, base, 7.0)
    colour += mark[..., None] * (rgb(ink) - rgb(base)) + (warp[..., None] - 0.5) * 30
    return Material(image(colour), specular=0.05, roughness=0.22)


def granite(rng: np.random.Generator, size: int = 512) -> Material:
    """Speckled stone worktop."""
    base = rgb([(150, 142, 134), (92, 92, 96), (178, 160, 140)][rng.integers(3)])
    colour = np.broadcast_to(base, (size, size, 3)) + (cloud(rng, size, 1.2)[..., None] - 0.5) * 60
    for shade, level in (((40, 38, 38), 0.80), ((222, 214, 204), 0.78), ((124, 92, 74), 0.82)):
        spots = cloud(rng, size, 0.75) > level - 0.1
        colour = np.where(spots[..., None], rgb(shade) + grain(rng, size)[..., None] * 8, colour)
    return Material(image(cv2.GaussianBlur(colour, (0, 0), 0.7)), specular=0.05, roughness=0.25)


def laminate(rng: np.random.Generator, size: int = 512) -> Material:
    """Worktop laminate: coloured chips on a plain ground."""
    base = rgb([(206, 200, 186), (168, 176, 178), (120, 128, 132), (190, 172, 150)][rng.integers(4)])
    colour = flat(rng, size, tuple(base), 5.0)
    for _ in range(900):
        centre = tuple(int(c) for c in rng.integers(0, size, 2))
        shade = tuple(float(c) for c in base * rng.uniform(0.45, 1.25))
        axes = tuple(int(a) for a in rng.integers(1, 6, 2))
        cv2.ellipse(colour, centre, axes, float(rng.uniform(0, 180)), 0, 360, shade, -1)
    return Material(image(colour), specular=0.04, roughness=0.35)


def tiles(rng: np.random.Generator, size: int = 512, across: int = 4) -> Material:
    """Glazed wall tiles with joints, each of a slightly different colour."""
    base = rgb([(214, 212, 202), (150, 178, 176), (198, 176, 142), (122, 146, 168), (208, 196, 190)][rng.integers(5)])
    colour = flat(rng, size, (196, 192, 184), 10.0)
    step, brick = size // across, rng.random() < 0.5
    for row in range(across * 2):
        for column in range(-1, across):
            x = column * step + (step // 2 if brick and row % 2 else 0)
            low, high = (max(x + 3, 0), row * step // 2 + 3), (min(x + step - 3, size - 1), (row + 1) * step // 2 - 3)
            cv2.rectangle(colour, low, high, tuple(float(c) for c in base * rng.uniform(0.88, 1.06)), -1)
    colour += (cloud(rng, size, 1.5)[..., None] - 0.5) * 36
    return Material(image(colour), specular=0.05, roughness=0.2, bump=0.5)


def metal(rng: np.random.Generator, size: int = 256, tone: float | None = None) -> Material:
    """Brushed metal, brushed along u."""
    base = tone if tone is not None else rng.uniform(120, 190)
    brush = (cloud(rng, size, 0.5, (8.0, 0.3)) - 0.5) * 70 + (cloud(rng, size, 1.5) - 0.5) * 30
    tint = rgb([1.0, 1.0, 1.01]) * base + brush[..., None]
    return Material(image(tint), specular=0.55, roughness=float(rng.uniform(0.28, 0.42)), metal=1.0)


def plastic(rng: np.random.Generator, colour: tuple[int, ...] | None = None, size: int = 128) -> Material:
    """Coloured plastic with fine grain and scratches."""
    return Material(image(flat(rng, size, colour or vivid(rng), 5.0)), specular=0.045, roughness=float(rng.uniform(0.25, 0.5)))


def rubber(rng: np.random.Generator, size: int = 128) -> Material:
    """Dark grip with ribs."""
    colour = flat(rng, size, (44, 44, 48), 5.0)
    colour[:: size // 16] += 26
    colour[1 :: size // 16] += 14
    return Material(image(colour), specular=0.03, roughness=0.75)


def ceramic(rng: np.random.Generator, size: int = 256) -> Material:
    """Glazed ceramic with a printed pattern: bands, dots, checks, flowers, speckles, or a word."""
    ground = (232, 228, 218) if rng.random() < 0.55 else vivid(rng, (150, 235), (0.2, 0.6))
    canvas = image(flat(rng, size, ground, 4.0))
    ink = [vivid(rng, (60, 200), (0.5, 0.95)) for _ in range(3)]
    PRINTS[rng.integers(len(PRINTS))](rng, canvas, ink)
    return Material(canvas, specular=0.05, roughness=0.18)


def _bands(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]]) -> None:
    size = len(canvas)
    for k in range(int(rng.integers(3, 6))):
        y = int(rng.uniform(0.1, 0.9) * size)
        canvas[y : y + int(rng.integers(5, 16))] = ink[k % 3]
    _dots(rng, canvas, ink, count=9)


def _dots(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]], count: int = 60) -> None:
    size = len(canvas)
    for k in range(count):
        centre = tuple(int(c) for c in rng.integers(0, size, 2))
        cv2.circle(canvas, centre, int(rng.integers(4, 11)), ink[k % 3], -1, cv2.LINE_AA)


def _checks(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]]) -> None:
    size, step = len(canvas), len(canvas) // int(rng.integers(6, 10))
    for row in range(0, size, step):
        for column in range(0, size, step):
            if (row // step + column // step) % 2:
                canvas[row : row + step, column : column + step] = ink[(row // step) % 2]


def _flowers(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]]) -> None:
    size = len(canvas)
    for k in range(16):
        x, y = rng.integers(16, size - 16, 2)
        for turn in np.linspace(0, 2 * np.pi, 6)[:-1]:
            petal = (int(x + 9 * np.cos(turn)), int(y + 9 * np.sin(turn)))
            cv2.circle(canvas, petal, 6, ink[k % 3], -1, cv2.LINE_AA)
        cv2.circle(canvas, (int(x), int(y)), 5, (240, 210, 80), -1, cv2.LINE_AA)


def _motto(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]]) -> None:
    size, font = len(canvas), FONTS[rng.integers(len(FONTS))]
    for k, x in enumerate((0.25, 0.75)):
        half = canvas[:, k * size // 2 : (k + 1) * size // 2].copy()
        write(half, word(rng), (size / 4, size * 0.5), size * 0.16, ink[0], font)
        canvas[:, k * size // 2 : (k + 1) * size // 2] = half
        cv2.circle(canvas, (int(x * size), int(0.26 * size)), size // 14, ink[1], -1, cv2.LINE_AA)
    canvas[int(0.82 * size) : int(0.88 * size)] = ink[2]
    canvas[int(0.08 * size) : int(0.12 * size)] = ink[2]


def _speckles(rng: np.random.Generator, canvas: np.ndarray, ink: list[tuple[int, ...]]) -> None:
    size = len(canvas)
    for k in range(500):
        cv2.circle(
            canvas, tuple(int(c) for c in rng.integers(0, size, 2)), int(rng.integers(1, 3)), ink[k % 2], -1, cv2.LINE_AA
        )
    canvas[: size // 5] = ink[2]


PRINTS = (_bands, _dots, _checks, _flowers, _motto, _speckles)


def label(rng: np.random.Generator, size: int = 256, repeat: int = 2) -> Material:
    """Printed label repeated `repeat` times around: bands, a badge, words, small print, a bar code."""
    ground, ink, accent = vivid(rng, (180, 250), (0.05, 0.35)), vivid(rng, (40, 150), (0.6, 1.0)), vivid(rng)
    width = 2 * size // repeat
    panel = image(flat(rng, max(size, width), ground, 3.0))[:size, :width].copy()
    panel[: size // 9], panel[-size // 9 :] = accent, accent
    font = FONTS[rng.integers(len(FONTS))]
    cv2.ellipse(panel, (width // 2, int(0.35 * size)), (int(0.42 * width), int(0.17 * size)), 0, 0, 360, ink, -1, cv2.LINE_AA)
    write(panel, word(rng), (width / 2, 0.35 * size), 0.15 * size, tuple(int(c) for c in ground), font)
    write(panel, word(rng), (width / 2, 0.62 * size), 0.09 * size, ink, font)
    small_print(panel, rng, int(0.08 * width), int(0.73 * size), int(0.38 * width), int(0.13 * size), ink)
    barcode(panel, rng, int(0.6 * width), int(0.71 * size), int(0.3 * width), int(0.14 * size))
    wrap = cv2.resize(np.tile(panel, (1, repeat, 1)), (2 * size, size), interpolation=cv2.INTER_AREA)
    return Material(wrap, specular=0.04, roughness=0.4)


def carton(rng: np.random.Generator, size: int = 256) -> Material:
    """Printed side of a package: a big word, a pattern of blobs, small print."""
    base, ink, accent = vivid(rng, (150, 240)), vivid(rng, (30, 110)), vivid(rng, (200, 255))
    canvas = image(flat(rng, size, base, 4.0))
    cv2.ellipse(canvas, (size // 2, int(0.68 * size)), (int(0.36 * size), int(0.2 * size)), 0, 0, 360, accent, -1, cv2.LINE_AA)
    for _ in range(40):
        centre = (int(size * rng.normal(0.5, 0.13)), int(size * rng.normal(0.68, 0.06)))
        cv2.circle(canvas, centre, int(rng.integers(4, 11)), vivid(rng, (90, 220)), -1, cv2.LINE_AA)
    band = slice(int(0.1 * size), int(0.4 * size))
    canvas[band] = (244, 240, 232)
    font = FONTS[rng.integers(len(FONTS))]
    write(canvas, word(rng), (size / 2, 0.22 * size), 0.13 * size, ink, font)
    write(canvas, word(rng), (size / 2, 0.35 * size), 0.05 * size, ink, font)
    small_print(canvas, rng, int(0.06 * size), int(0.9 * size), int(0.5 * size), int(0.08 * size), (250, 250, 250))
    barcode(canvas, rng, int(0.68 * size), int(0.86 * size), int(0.26 * size), int(0.11 * size))
    return Material(canvas, specular=0.03, roughness=0.6)


def cloth(rng: np.random.Generator, size: int = 256) -> Material:
    """Woven cloth: plain, striped, checked or denim."""
    base = rgb(vivid(rng, (50, 170), (0.1, 0.7)))
    y, x = np.mgrid[0:size, 0:size]
    weave = 0.86 + 0.14 * np.cos(2 * np.pi * x / 4) * np.cos(2 * np.pi * y / 4)
    colour = base * weave[..., None] + (cloud(rng, size, 1.0)[..., None] - 0.5) * 40
    style, other = rng.integers(4), rgb(vivid(rng, (40, 220), (0.1, 0.8)))
    stripes, rungs = (x // (size // 8)) % 2 == 0, (y // (size // 8)) % 2 == 0
    mark = {0: np.zeros_like(stripes), 1: stripes, 2: stripes | rungs, 3: rungs}[int(style)]
    colour = np.where(mark[..., None], 0.55 * colour + 0.45 * other * weave[..., None], colour)
    return Material(image(colour), specular=0.01, roughness=0.95, bump=0.3)


def cutting_mat(rng: np.random.Generator, size: int = 512) -> Material:
    """A ruled cutting mat."""
    ground, ink = [((28, 92, 74), (170, 206, 170)), ((44, 66, 108), (186, 198, 214)), ((52, 52, 56), (190, 190, 186))][
        rng.integers(3)
    ]
    canvas = image(flat(rng, size, ground, 5.0))
    for k in range(0, size, size // 16):
        wide = 2 if k % (size // 4) == 0 else 1
        cv2.line(canvas, (k, 0), (k, size), ink, wide, cv2.LINE_AA)
        cv2.line(canvas, (0, k), (size, k), ink, wide, cv2.LINE_AA)
    return Material(canvas, specular=0.03, roughness=0.7)


def leather(rng: np.random.Generator, size: int = 256) -> Material:
    """Leather with pores and folds."""
    base = [(110, 70, 44), (58, 44, 38), (140, 40, 36), (40, 56, 84)][rng.integers(4)]
    folds = np.abs(cloud(rng, size, 1.0) - 0.5)
    colour = flat(rng, size, base, 4.0) * (0.75 + 0.9 * np.clip(folds, 0, 0.3)[..., None])
    return Material(image(colour), specular=0.035, roughness=0.55, bump=0.6)


def paper(rng: np.random.Generator, size: int = 256) -> Material:
    """A written or printed page."""
    canvas = image(flat(rng, size, (238, 234, 224), 3.0))
    write(canvas, word(rng), (size / 2, 0.1 * size), 0.06 * size, (50, 50, 60), FONTS[0])
    small_print(canvas, rng, int(0.1 * size), int(0.2 * size), int(0.8 * size), int(0.7 * size), (96, 96, 110))
    return Material(canvas, specular=0.02, roughness=0.9)


def pages(rng: np.random.Generator, size: int = 64) -> Material:
    """Edges of a stack of paper."""
    colour = flat(rng, size, (226, 220, 204), 4.0) - (rng.random((size, 1, 1)) * 46).astype(np.float32)
    return Material(image(colour), specular=0.02, roughness=0.95)


def skin(rng: np.random.Generator, tone: tuple[float, ...], size: int = 256) -> Material:
    """Skin with blotches and pores; `tone` sRGB 0..255."""
    blotch = (cloud(rng, size, 1.6) - 0.5)[..., None] * rgb([14, 24, 24])
    pores = (cloud(rng, size, 0.5) - 0.5)[..., None] * 26 + grain(rng, size)[..., None] * 2
    return Material(image(rgb(tone) + blotch + pores), specular=0.035, roughness=0.46, bump=0.25, skin=1.0)
