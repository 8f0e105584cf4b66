"""Letters in pictures: the same on every machine, with Greek, Cyrillic and accents."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

EDGE_PX = 2
"""dark edge around the letters of a label"""


@cache
def font(size_px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which matplotlib ships on every platform."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, size_px)


def draw_label(rgb: np.ndarray, text: str, at: tuple[int, int], size_px: int) -> None:
    """Write white letters with a dark edge into a picture (h, w, 3) uint8, in place; `at` is the upper left corner, px (x, y).
    Letters and edge come from one outline, so that they fit each other, and may be of any alphabet.
    """
    picture = Image.fromarray(rgb)
    ImageDraw.Draw(picture).text(at, text, (255, 255, 255), font(size_px), stroke_width=EDGE_PX, stroke_fill=(0, 0, 0))
    rgb[:] = np.asarray(picture)
