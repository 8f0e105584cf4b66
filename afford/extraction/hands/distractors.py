"""Looks of augmented pictures: skin of another tone, gloves, and distractors in the colours of skin."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from afford.common.palette import TONES
from afford.render.patterns import cloud
from schemas.scene import LEFT_HAND, RIGHT_HAND


def retone(rgb: np.ndarray, labels: np.ndarray, rng: np.random.Generator, retoned: float, gloved: float) -> np.ndarray:
    """Make skin paler, darker or flatter with probability `retoned`, or put gloves on the hands with probability `gloved`."""
    hand, chance = np.isin(labels, (LEFT_HAND, RIGHT_HAND)), rng.random()
    if chance >= retoned + gloved or not hand.any():
        return rgb
    skin = rgb[hand].astype(np.float32)
    mean = skin.mean(0)
    if chance < gloved:
        skin = skin.mean(1, keepdims=True) / max(float(mean.mean()), 1.0) * random_colour(rng)
    else:
        skin = mean + (skin - mean) * rng.uniform(0.4, 1.1)
        skin = 255 - (255 - skin) * rng.uniform(0.3, 0.9) if rng.random() < 0.5 else skin * rng.uniform(0.4, 0.9)
    out = rgb.copy()
    out[hand] = np.clip(skin, 0, 255)
    return out


def blobs(rgb: np.ndarray, rng: np.random.Generator, colour: Callable[[np.random.Generator], np.ndarray]) -> np.ndarray:
    """Paint one to three roundish shaded blobs on the picture."""
    out = rgb.copy()
    height, width = rgb.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    for _ in range(int(rng.integers(1, 4))):
        turn = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 12))))
        radius = rng.uniform(0.03, 0.3) * width * rng.uniform(0.4, 1.0, len(turn))
        centre = rng.uniform(0, 1, 2) * (width, height)
        outline = centre + np.stack([np.cos(turn) * rng.uniform(0.3, 1.0), np.sin(turn)], 1) * radius[:, None]
        mask = np.zeros((height, width), np.uint8)
        cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))) > 0
        slope = ((x - centre[0]) * rng.normal() + (y - centre[1]) * rng.normal()) / max(float(radius.max()), 1.0)
        shade = 1 + 0.2 * np.tanh(slope) + 0.15 * (_texture(height, width, rng) - 0.5)
        out[mask] = np.clip(colour(rng) * shade[mask][:, None], 0, 255).astype(np.uint8)
    return out


def face(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a face: hair, an oval of skin, eyes, brows and a mouth."""
    out, (height, width), half = rgb.copy(), rgb.shape[:2], int(rng.uniform(0.03, 0.22) * rgb.shape[1]) + 3
    x, y, turn = int(rng.integers(width)), int(rng.integers(height)), float(rng.uniform(-25, 25))
    skin, hair = skin_colour(rng), rng.uniform(10, 150) * np.array([1.0, 0.8, 0.6])
    dark = skin * rng.uniform(0.2, 0.6)
    cv2.ellipse(out, (x, y - half // 6), (int(0.9 * half), int(1.25 * half)), turn, 0, 360, hair.tolist(), -1, cv2.LINE_AA)
    cv2.ellipse(out, (x, y), (int(0.72 * half), half), turn, 0, 360, np.clip(skin, 0, 255).tolist(), -1, cv2.LINE_AA)
    along = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))]) * half
    across = np.array([-along[1], along[0]])
    marks = ((-0.32, -0.2, 0.13, 0.07), (0.32, -0.2, 0.13, 0.07), (-0.32, -0.38, 0.18, 0.03), (0.32, -0.38, 0.18, 0.03),
             (0.0, 0.5, 0.26, 0.08), (0.0, 0.15, 0.1, 0.05))  # fmt: skip
    for right, below, wide, high in marks:
        at = np.array([x, y]) + right * along + below * across
        axes = max(1, round(wide * half)), max(1, round(high * half))
        cv2.ellipse(out, (round(at[0]), round(at[1])), axes, turn, 0, 360, dark.tolist(), -1, cv2.LINE_AA)
    shade = 1 + 0.3 * (_texture(height, width, rng) - 0.5)
    drawn = (out != rgb).any(2)
    out[drawn] = np.clip(out[drawn] * shade[drawn][:, None], 0, 255).astype(np.uint8)
    return out


def _texture(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    return cv2.resize(cloud(rng, 32, float(rng.uniform(0.5, 2.0))), (width, height))


def skin_colour(rng: np.random.Generator) -> np.ndarray:
    """Draw a colour of skin (3,), 0..255 or a little above."""
    return np.array(TONES[int(rng.integers(len(TONES)))]) * rng.uniform(0.7, 1.25) * rng.uniform(0.92, 1.08, 3)


def random_colour(rng: np.random.Generator) -> np.ndarray:
    """Draw any colour (3,), 0..255."""
    return rng.uniform(0, 255, 3)
