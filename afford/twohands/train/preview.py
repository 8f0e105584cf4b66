"""A sheet of pictures while a training goes on: what was said filled, what is true outlined; left and right in their colours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from afford.common.image_files import jpeg
from afford.common.palette import LEFT, RIGHT
from afford.twohands.train.scores import Said

COLUMNS, ROWS = 4, 3
OPACITY = 0.6


def write(path: Path, asked: Sequence[tuple[np.ndarray, str]], said: Sequence[Said]) -> None:
    """Write a JPEG of samples spread over all of them; `asked` are images (h, w, 3) uint8 and their tasks."""
    count = min(COLUMNS * ROWS, len(said))
    chosen = [round(n * (len(said) - 1) / max(count - 1, 1)) for n in range(count)]
    tiles = [tile(*asked[n], said[n]) for n in chosen]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    lines = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
    path.write_bytes(jpeg(np.vstack(lines)))


def tile(image: np.ndarray, task: str, said: Said) -> np.ndarray:
    """One sample, (h + 16, w, 3) uint8."""
    picture = image.astype(np.float32)
    for colour, region in zip((LEFT, RIGHT), said.regions[0], strict=True):
        weight = OPACITY * region[..., None]
        picture = picture * (1 - weight) + np.array(colour, np.float32) * weight
    drawn = np.ascontiguousarray(picture.round().astype(np.uint8))
    for colour, mask in zip((LEFT, RIGHT), said.truth, strict=True):
        outlines, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, outlines, -1, colour, 1)
    words = np.zeros((16, image.shape[1], 3), np.uint8)
    cv2.putText(words, task.encode("ascii", "replace").decode(), (2, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 255), 1)
    return np.vstack([drawn, words])
