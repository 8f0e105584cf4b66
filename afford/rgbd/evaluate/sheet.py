"""Answers to look at: the last frame, what is true, what was said of the video and of the picture, and where attention went.

Labels have the colours of the data set, where the model is sure of them by more than the 0.75 that the paper draws.
"""

from __future__ import annotations

import cv2
import numpy as np
from PIL import Image, ImageDraw

from afford.common.drawing import font
from afford.common.palette import INK, PAPER
from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR, InteractionScores, ShownAnswer

CONFIDENCE = 0.75
OPACITY = 0.65
SIDE_PX, HEAD_PX, WORDS_PX, GAP_PX, LETTERS_PX = 150, 26, 20, 4, 13
WIDE = 2
"""sequences side by side"""


def draw(scores: InteractionScores) -> np.ndarray:
    """(h, w, 3) uint8 RGB: a strip for each answer that was kept. ValueError when none was."""
    if not scores.shown:
        raise ValueError(f"{scores.name}: expected answers to show, got none")
    strips = [_strip(one, scores) for one in scores.shown]
    strips += [np.full_like(strips[0], PAPER)] * (-len(strips) % WIDE)
    head = np.concatenate([_band(["last frame", "truth", *scores.mode, "attention"], HEAD_PX)] * WIDE, axis=1)
    return np.concatenate([head, *(np.concatenate(strips[n : n + WIDE], axis=1) for n in range(0, len(strips), WIDE))])


def tinted(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 RGB, grey, with the data set's colours over what affords something."""
    colours = np.zeros((BACKGROUND + 1, 3), np.float32)
    colours[:BACKGROUND] = [COLOURS_BGR[name][::-1] for name in AFFORDANCES]
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    grey = rgb.mean(-1, keepdims=True).repeat(3, -1)
    return np.round(grey * (1 - weight) + colours[label] * weight).astype(np.uint8)


def heated(rgb: np.ndarray, attention: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 RGB: bright where attention is; the frame in grey where there is none."""
    grey = rgb.mean(-1, keepdims=True).repeat(3, -1)
    if not attention.size:
        return grey.astype(np.uint8)
    large = cv2.resize(attention / attention.max(), rgb.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    heat = cv2.applyColorMap((255 * large).astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
    return np.round(0.35 * grey + 0.65 * heat).astype(np.uint8)


def _strip(one: ShownAnswer, scores: InteractionScores) -> np.ndarray:
    sure = np.where(one.confidence > CONFIDENCE, one.label, BACKGROUND)
    tiles = [one.rgb, tinted(one.rgb, one.truth), *(tinted(one.rgb, label) for label in sure), heated(one.rgb, one.attention[0])]
    shown = [_framed(cv2.resize(tile, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_NEAREST)) for tile in tiles]
    return np.concatenate([np.concatenate(shown, axis=1), _band(_words(one, scores), WORDS_PX)])


def _words(one: ShownAnswer, scores: InteractionScores) -> list[str]:
    """Thing, true action, and the actions that were said."""
    at = scores.clip.index(one.clip)
    said = [AFFORDANCES[int(k)] for k in scores.action[at].argmax(-1)]
    return [scores.object_type[at], scores.affordance[at], *said, ""]


def _framed(tile: np.ndarray) -> np.ndarray:
    return np.pad(tile, ((GAP_PX, 0), (GAP_PX, 0), (0, 0)), constant_values=PAPER[0])


def _band(words: list[str], height: int) -> np.ndarray:
    """Words above or below the pictures of a strip."""
    image = Image.new("RGB", (len(words) * (SIDE_PX + GAP_PX), height), PAPER)
    pen = ImageDraw.Draw(image)
    for n, word in enumerate(words):
        pen.text((n * (SIDE_PX + GAP_PX) + GAP_PX, 2), word, INK, font(LETTERS_PX))
    return np.asarray(image)
