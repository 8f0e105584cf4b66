"""Sheet of predictions: last frame, truth, prediction of the video and of the picture, attention.

Labels have the colours of the data set; they are shown where the model's confidence exceeds the paper's 0.75.
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
"""sequences in a row"""


def draw_sheet(scores: InteractionScores) -> np.ndarray:
    """Draw a strip for each kept answer, (h, w, 3) uint8 RGB. ValueError without any."""
    if not scores.shown:
        raise ValueError(f"{scores.name}: no predictions to show; evaluate with shown of 1 or more")
    strips = [_strip(one, scores) for one in scores.shown]
    strips += [np.full_like(strips[0], PAPER)] * (-len(strips) % WIDE)
    head = np.concatenate([_band(["last frame", "truth", *scores.mode, "attention"], HEAD_PX)] * WIDE, axis=1)
    return np.concatenate([head, *(np.concatenate(strips[n : n + WIDE], axis=1) for n in range(0, len(strips), WIDE))])


def tint_regions(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Grey picture (h, w, 3) uint8 RGB with the data set's colours over its affordances."""
    colours = np.zeros((BACKGROUND + 1, 3), np.float32)
    colours[:BACKGROUND] = [COLOURS_BGR[name][::-1] for name in AFFORDANCES]
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    grey = rgb.mean(-1, keepdims=True).repeat(3, -1)
    return np.round(grey * (1 - weight) + colours[label] * weight).astype(np.uint8)


def overlay_attention(rgb: np.ndarray, attention: np.ndarray) -> np.ndarray:
    """Heat of the attention over a grey frame, (h, w, 3) uint8 RGB; the grey frame without attention."""
    grey = rgb.mean(-1, keepdims=True).repeat(3, -1)
    if not attention.size:
        return grey.astype(np.uint8)
    large = cv2.resize(attention / attention.max(), rgb.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    heat = cv2.applyColorMap((255 * large).astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
    return np.round(0.35 * grey + 0.65 * heat).astype(np.uint8)


def _strip(one: ShownAnswer, scores: InteractionScores) -> np.ndarray:
    confident = np.where(one.confidence > CONFIDENCE, one.label, BACKGROUND)
    labels = [tint_regions(one.rgb, label) for label in (one.truth, *confident)]
    tiles = [one.rgb, *labels, overlay_attention(one.rgb, one.attention[0])]
    shown = [_framed(cv2.resize(tile, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_NEAREST)) for tile in tiles]
    return np.concatenate([np.concatenate(shown, axis=1), _band(_words(one, scores), WORDS_PX)])


def _words(one: ShownAnswer, scores: InteractionScores) -> list[str]:
    """Object, true action, and the predicted actions."""
    at = scores.clip.index(one.clip)
    predicted = [AFFORDANCES[int(k)] for k in scores.action[at].argmax(-1)]
    return [scores.object_type[at], scores.affordance[at], *predicted, ""]


def _framed(tile: np.ndarray) -> np.ndarray:
    return np.pad(tile, ((GAP_PX, 0), (GAP_PX, 0), (0, 0)), constant_values=PAPER[0])


def _band(words: list[str], height: int) -> np.ndarray:
    """Row of texts above or below the pictures of a strip."""
    image = Image.new("RGB", (len(words) * (SIDE_PX + GAP_PX), height), PAPER)
    pen = ImageDraw.Draw(image)
    for n, word in enumerate(words):
        pen.text((n * (SIDE_PX + GAP_PX) + GAP_PX, 2), word, INK, font(LETTERS_PX))
    return np.asarray(image)
