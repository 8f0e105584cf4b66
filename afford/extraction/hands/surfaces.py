"""Backgrounds without hands: walls, wood, tiles, stone, cloth, paper and skin-coloured plaster, or photographs of the user.

A finder that has seen only rendered rooms takes real wood and walls for skin. These surfaces fill the picture at any scale, often
in the colours of skin and under coloured light.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from afford.extraction.hands.distractors import skin_colour
from afford.render import materials
from afford.render.patterns import cloud
from afford.render.scene import Material

TEXTURE_PX = 256
"""side of a texture"""
KINDS: tuple[Callable[[np.random.Generator], Material], ...] = (
    lambda rng: materials.wood(rng, size=TEXTURE_PX, planks=int(rng.integers(1, 6))),
    lambda rng: materials.tiles(rng, size=TEXTURE_PX, across=int(rng.integers(2, 6))),
    lambda rng: materials.marble(rng, size=TEXTURE_PX),
    lambda rng: materials.cloth(rng, size=TEXTURE_PX),
    lambda rng: materials.paper(rng, size=TEXTURE_PX),
)
HELD_OUT_KINDS: tuple[Callable[[np.random.Generator], Material], ...] = (
    lambda rng: materials.granite(rng, size=TEXTURE_PX),
    lambda rng: materials.laminate(rng, size=TEXTURE_PX),
    lambda rng: materials.leather(rng, size=TEXTURE_PX),
)
"""kinds that only validation shows"""
PLASTER = 0.4
"""share of textures that are plaster: one colour with clouds of any scale"""
SKIN_COLOURED = 0.5
"""share of surfaces whose mean colour becomes that of a skin"""
HORIZON = 0.4
"""share of pictures with two surfaces, such as a table before a wall"""
TILTED = 0.6
"""share of surfaces in perspective"""


def textures(count: int, rng: np.random.Generator, held_out: bool = False) -> tuple[np.ndarray, ...]:
    """Draw `count` textures (TEXTURE_PX, TEXTURE_PX, 3) uint8 of the kinds of training, or of those held out."""
    kinds = HELD_OUT_KINDS if held_out else KINDS
    return tuple(_plaster(rng) if rng.random() < PLASTER else kinds[int(rng.integers(len(kinds)))](rng).image for _ in range(count))


def surface_picture(bank: tuple[np.ndarray, ...], size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Compose a picture (h, w, 3) uint8 of `size` (height, width) from one or two surfaces with shading and shadow."""
    picture = _surface(bank[int(rng.integers(len(bank)))], size, rng)
    if rng.random() < HORIZON:
        y, x = np.mgrid[0 : size[0], 0 : size[1]]
        upper = y < size[0] * rng.uniform(0.1, 0.7) + (x - size[1] / 2) * rng.normal(0, 0.25)
        picture = np.where(upper[..., None], _surface(bank[int(rng.integers(len(bank)))], size, rng), picture)
    return np.clip(picture * _light(size, rng) + 0.5, 0, 255).astype(np.uint8)


def _plaster(rng: np.random.Generator) -> np.ndarray:
    rough, strength = rng.uniform(0.5, 2.2), rng.uniform(4, 60)
    stretch = (1.0, float(rng.choice([1.0, 1.0, 6.0])))
    level = rng.uniform(60, 220, 3) * 0.3 + rng.uniform(60, 220) * 0.7
    field = cloud(rng, TEXTURE_PX, float(rough), stretch) - 0.5
    return np.clip(level + strength * field[..., None], 0, 255).astype(np.uint8)


def _surface(texture: np.ndarray, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """View a repeated texture from a random distance, rotated and often tilted; (h, w, 3) float32."""
    height, width = size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = (x - width / 2) / width, (y - height / 2) / width
    depth = 1 / (1 + np.float32(rng.uniform(0, 1.2)) * (y + height / width / 2)) if rng.random() < TILTED else np.float32(1)
    turn, scale = rng.uniform(0, 2 * np.pi), TEXTURE_PX * np.exp(rng.uniform(np.log(0.35), np.log(2.5)))
    at = rng.uniform(0, TEXTURE_PX, 2)
    u = scale * depth * (np.cos(turn) * x - np.sin(turn) * y) + at[0]
    v = scale * depth * (np.sin(turn) * x + np.cos(turn) * y) + at[1]
    seen = cv2.remap(texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    out = seen.astype(np.float32)
    if rng.random() < SKIN_COLOURED:
        out *= (skin_colour(rng) / np.maximum(out.mean((0, 1)), 1)).astype(np.float32)
    return out


def _light(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Draw a smooth gradient of brightness, and sometimes the edge of a shadow; (h, w, 1) float32."""
    y, x = np.mgrid[-1 : 1 : size[0] * 1j, -1 : 1 : size[1] * 1j]
    shade = 1 + rng.normal(0, 0.2) * x + rng.normal(0, 0.2) * y
    if rng.random() < 0.3:
        turn, wide = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(np.log(0.02), np.log(0.4)))
        off = (np.cos(turn) * x + np.sin(turn) * y - rng.uniform(-0.7, 0.7)) / wide
        shade = shade * (1 - rng.uniform(0.2, 0.6) / (1 + np.exp(-np.clip(off, -30, 30))))
    return np.asarray(np.clip(shade, 0.2, 1.8)[..., None].astype(np.float32))
