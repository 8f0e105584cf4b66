"""What contact sheets are made of: a picture with its overlay, titles, gaps, a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

TILE_W, HEAD, GAP = 304, 30, 4
BACK, INK = (24, 26, 30), (236, 238, 240)


def titles(words: Sequence[str], width: int, step: int = TILE_W) -> np.ndarray:
    """A line of titles, one over each tile."""
    page = Image.new("RGB", (width, HEAD), BACK)
    draw = ImageDraw.Draw(page)
    for n, title in enumerate(words):
        draw.text((n * (step + GAP) + 8, 6), title, fill=INK, font=ImageFont.load_default(15))
    return np.asarray(page)


def framed(tile: np.ndarray) -> np.ndarray:
    """A tile with a gap to the right and below."""
    return cv2.copyMakeBorder(tile, 0, GAP, 0, GAP, cv2.BORDER_CONSTANT, value=BACK)


def write_page(out: Path, strips: Sequence[np.ndarray]) -> None:
    """Strips below each other as a PNG; narrower ones are filled up."""
    width = max(strip.shape[1] for strip in strips)
    wide = [cv2.copyMakeBorder(strip, 0, 0, 0, width - strip.shape[1], cv2.BORDER_CONSTANT, value=BACK) for strip in strips]
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(wide)).save(out)


