"""Preview of a part scorer: candidates with the predicted and the true part."""

from __future__ import annotations

import cv2
import numpy as np
import torch

from afford.common.drawing import draw_label, font
from afford.surface.describe.looks import part_phrase
from afford.surface.score.part_scorer import PartScorer
from afford.surface.score.samples import CHANNELS, SIZE
from schemas.surface import PartLessons

COLUMNS, ROWS, SCALE, WORDS_PX = 6, 3, 3, 11
RIGHT, WRONG = (0, 158, 115), (213, 94, 0)
"""colours of the mask for a correct and a wrong prediction (Okabe and Ito)"""
OPACITY = 0.45
GREY, MASK = CHANNELS.index("brightness"), CHANNELS.index("mask")


def preview_sheet(model: PartScorer, one: PartLessons) -> np.ndarray:
    """Draw evenly spaced candidates of one object: (h, w, 3) uint8; `model` is in evaluation mode."""
    shares = predict_shares(model, one)
    chosen = np.linspace(0, len(shares) - 1, min(COLUMNS * ROWS, len(shares))).round().astype(int)
    tiles = [_tile(one, int(n), shares[n]) for n in chosen]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    return np.vstack([np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)])


def predict_shares(model: PartScorer, one: PartLessons) -> np.ndarray:
    """Predict the share (m, p) of each candidate that shows each part."""
    phrases = tuple(part_phrase(one.category, part) for part in one.parts)
    with torch.inference_mode():
        logits = model(torch.tensor(one.crops).float() / 255, torch.tensor(one.traits), phrases)
    found: np.ndarray = logits[..., 0].sigmoid().numpy()
    return found


def part_accuracy(shares: np.ndarray, one: PartLessons) -> float:
    """Return the share of candidates whose main part is predicted correctly."""
    return float((shares.argmax(1) == one.share.argmax(1)).mean())


def _tile(one: PartLessons, n: int, shares: np.ndarray) -> np.ndarray:
    """Draw the close crop of a candidate with its mask, and predicted and true part below it."""
    named, true = int(shares.argmax()), int(one.share[n].argmax())
    grey, mask = one.crops[n, 0, GREY], one.crops[n, 0, MASK, ..., None] / 255
    colour = np.array(RIGHT if named == true else WRONG)
    mixed = grey[..., None] * (1 - OPACITY * mask) + colour * OPACITY * mask
    large = cv2.resize(mixed.astype(np.uint8), (SIZE * SCALE, SIZE * SCALE), interpolation=cv2.INTER_NEAREST)
    words = np.zeros((2 * WORDS_PX + 10, SIZE * SCALE, 3), np.uint8)
    for row, text in enumerate((f"{one.parts[named]} {shares[named]:.2f}", f"true: {one.parts[true]} {one.share[n, true]:.2f}")):
        draw_label(words, _fitting(text), (3, 2 + row * (WORDS_PX + 4)), WORDS_PX)
    return np.vstack([large, words])


def _fitting(text: str) -> str:
    """Cut text to the width of a tile."""
    while font(WORDS_PX).getlength(text) > SIZE * SCALE - 6:
        text = text[:-1]
    return text
