"""Affordances for the eye: regions in colours that can be told apart, a legend, attention as heat.

The colours of mask files (`COLOURS_BGR`) are nearly all greens; these are for looking alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from PIL import Image, ImageDraw

from afford.common.drawing import font
from afford.common.palette import FAINT, INK, PAPER, Colour
from schemas.interaction import AFFORDANCES, BACKGROUND

COLOURS: dict[str, Colour] = {
    "grasp": (0, 158, 115), "cut": (230, 159, 0), "lift": (0, 114, 178), "push": (204, 121, 167), "rotate": (240, 228, 66),
    "hammer": (213, 94, 0), "squeeze": (86, 180, 233), "paint": (148, 82, 200), "type": (220, 50, 60)}  # fmt: skip
"""Okabe and Ito's seven, violet and red"""
OPACITY = 0.55


def painted(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8: a picture with the regions of `label` (h, w) tinted."""
    table = np.array([*(COLOURS[name] for name in AFFORDANCES), (0, 0, 0)], np.float32)
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    return np.asarray((rgb * (1 - weight) + table[label] * weight).round().astype(np.uint8))


def heat(attention: np.ndarray, height_px: int, width_px: int) -> np.ndarray:
    """(h, w, 3) uint8 RGB: an attention map (h', w'), its largest share bright yellow. Nearest cells, as the model enlarges it."""
    grey = (255 * attention / max(float(attention.max(initial=0)), 1e-12)).round().astype(np.uint8)
    if not grey.size:
        grey = np.zeros((1, 1), np.uint8)
    large = cv2.resize(grey, (width_px, height_px), interpolation=cv2.INTER_NEAREST)
    return cv2.cvtColor(cv2.applyColorMap(large, cv2.COLORMAP_INFERNO), cv2.COLOR_BGR2RGB)


def legend(said: Mapping[str, str], title: str, width_px: int) -> np.ndarray:
    """(h, width_px, 3) uint8: a line of words, below it a swatch for each affordance with what is said of it."""
    unit = max(13, width_px // 40)
    columns = max(1, width_px // (13 * unit))
    rows = -(-len(said) // columns)
    page = Image.new("RGB", (width_px, round((2.4 + 1.6 * rows) * unit)), PAPER)
    draw = ImageDraw.Draw(page)
    draw.text((unit, round(0.5 * unit)), title, INK, font(round(1.05 * unit), bold=True))
    for n, (name, words) in enumerate(said.items()):
        x, y = unit + (n % columns) * ((width_px - unit) // columns), round((2.1 + 1.6 * (n // columns)) * unit)
        draw.rounded_rectangle((x, y, x + unit, y + unit), unit // 5, COLOURS[name])
        draw.text((x + round(1.5 * unit), y + unit // 2), f"{name} {words}", INK if words else FAINT, font(round(0.85 * unit)),
                  anchor="lm")  # fmt: skip
    return np.asarray(page)
