"""Drawing on images: text labels, tiles of contact sheets, overlays of the regions of both hands.

Text is drawn with the DejaVu fonts of matplotlib, so that it looks the same on every machine and may contain Greek, Cyrillic and
accents.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from afford.common.palette import FAINT, HANDS, INK, PAPER, Colour
from schemas.affordance import TAXONOMY
from schemas.benchmark import Prediction
from schemas.video import SIDES

EDGE_PX = 2
"""width of the dark edge around the letters of a label"""


@cache
def font(size_px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Load DejaVu Sans, which matplotlib ships on every platform."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, size_px)


def draw_label(rgb: np.ndarray, text: str, at: tuple[int, int], size_px: int) -> None:
    """Write white text with a dark edge into an image (h, w, 3) uint8, in place.

    `at` is the upper left corner (x, y) in pixels. Text and edge are drawn from one outline.
    """
    picture = Image.fromarray(rgb)
    ImageDraw.Draw(picture).text(at, text, (255, 255, 255), font(size_px), stroke_width=EDGE_PX, stroke_fill=(0, 0, 0))
    rgb[:] = np.asarray(picture)


TILE_W, TITLE_H, GAP = 304, 30, 4
TILE_BACKGROUND, TILE_INK = (24, 26, 30), (236, 238, 240)


def title_row(words: Sequence[str], width: int, step: int = TILE_W) -> np.ndarray:
    """Draw a row of titles, one over each tile."""
    page = Image.new("RGB", (width, TITLE_H), TILE_BACKGROUND)
    draw = ImageDraw.Draw(page)
    for n, title in enumerate(words):
        draw.text((n * (step + GAP) + 8, 6), title, fill=TILE_INK, font=ImageFont.load_default(15))
    return np.asarray(page)


def pad_tile(tile: np.ndarray) -> np.ndarray:
    """Add a gap to the right of a tile and below it."""
    return cv2.copyMakeBorder(tile, 0, GAP, 0, GAP, cv2.BORDER_CONSTANT, value=TILE_BACKGROUND)


def write_page(out: Path, strips: Sequence[np.ndarray]) -> None:
    """Write strips below each other as a PNG; narrower strips are padded."""
    width = max(strip.shape[1] for strip in strips)
    wide = [cv2.copyMakeBorder(strip, 0, 0, 0, width - strip.shape[1], cv2.BORDER_CONSTANT, value=TILE_BACKGROUND)
            for strip in strips]
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(wide)).save(out)


TRACK = (226, 228, 226)
WORDS = {"left": "left hand", "right": "right hand", "both_same": "both, one thing", "both_different": "both, two things"}
OPACITY = 0.45
MIN_WIDTH_PX = 640
"""smaller images are enlarged, so that the legend can be read"""


def overlay(rgb: np.ndarray, prediction: Prediction) -> np.ndarray:
    """Draw the regions of both hands into an image, with a legend of the prediction below.

    Returns (h', w', 3) uint8 RGB: the image at its own size, or enlarged to MIN_WIDTH_PX, and the legend.
    """
    scale = max(1.0, MIN_WIDTH_PX / rgb.shape[1])
    size = round(rgb.shape[1] * scale), max(1, round(rgb.shape[0] * scale))
    drawn = cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC) if scale > 1 else rgb.copy()
    for side in SIDES:
        region = cv2.resize(prediction.mask(side).view(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        paint(drawn, region, HANDS[side])
    return np.vstack([drawn, legend(prediction, size[0])])


def paint(image: np.ndarray, region: np.ndarray, colour: Colour) -> None:
    """Tint a region (h, w) bool of an RGB image in place, and draw its outline in white and the colour."""
    image[region] = (image[region] * (1 - OPACITY) + np.array(colour) * OPACITY).round().astype(np.uint8)
    outlines, _ = cv2.findContours(region.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    width = max(1, round(max(image.shape[:2]) / 640))
    cv2.drawContours(image, outlines, -1, (255, 255, 255), 3 * width, cv2.LINE_AA)
    cv2.drawContours(image, outlines, -1, colour, width, cv2.LINE_AA)


def legend(prediction: Prediction, width: int) -> np.ndarray:
    """Draw the legend (h, width, 3) uint8: the task, a line for each hand, a bar for each class of the taxonomy."""
    unit = max(15, width // 42)
    title = _lines(prediction.task, font(round(1.15 * unit), bold=True), width - 2 * unit)
    below = round((1.0 + 1.6 * len(title)) * unit)
    band = Image.new("RGB", (width, below + round(6.4 * unit)), PAPER)
    draw = ImageDraw.Draw(band)
    for n, line in enumerate(title):
        draw.text((unit, round((0.7 + 1.6 * n) * unit)), line, INK, font(round(1.15 * unit), bold=True))
    for n, side in enumerate(SIDES):
        _hand(draw, prediction, n, side, (unit, below + round((0.5 + 2.9 * n) * unit)), unit)
    for n, name in enumerate(TAXONOMY):
        at = (width // 2, below + round((0.35 + 1.4 * n) * unit))
        _bar(draw, name, float(prediction.taxonomy[n]), at, width // 2 - unit, unit)
    return np.asarray(band)


def _hand(draw: ImageDraw.ImageDraw, prediction: Prediction, n: int, side: str, at: tuple[int, int], unit: int) -> None:
    """Draw swatch, name, score and area of one hand."""
    used, (x, y) = bool(prediction.hands[n]), at
    colour, text_x, share = HANDS[side] if used else FAINT, x + round(1.5 * unit), prediction.mask(n).mean()
    summary = f"score {prediction.score[n].max():.2f}, {share:.1%} of the picture" if used else "not needed"
    if used and not share and prediction.present < 1:
        summary = f"no region: {prediction.present:.0%} likely to be there"
    draw.rounded_rectangle((x, y, x + unit, y + unit), unit // 5, colour if used else None, colour, max(1, unit // 10))
    ink, bold, plain = INK if used else FAINT, font(round(0.95 * unit), bold=True), font(round(0.85 * unit))
    draw.text((text_x, y + unit // 2), f"{side} hand", ink, bold, anchor="lm")
    draw.text((text_x, y + round(1.6 * unit)), summary, FAINT, plain, anchor="lm")


def _bar(draw: ImageDraw.ImageDraw, name: str, value: float, at: tuple[int, int], width: int, unit: int) -> None:
    """Draw one class of the taxonomy and its probability."""
    x, y = at
    middle, start, end = y + unit // 2, x + round(8.2 * unit), x + width - round(2.6 * unit)
    draw.text((x, middle), WORDS[name], INK, font(round(0.9 * unit)), anchor="lm")
    draw.rounded_rectangle((start, y + unit // 5, end, y + unit * 4 // 5), unit // 4, TRACK)
    if value * (end - start) >= 1:
        draw.rounded_rectangle((start, y + unit // 5, start + value * (end - start), y + unit * 4 // 5), unit // 4, INK)
    draw.text((x + width, middle), f"{value:.0%}", INK, font(round(0.9 * unit)), anchor="rm")


def _lines(text: str, font: ImageFont.FreeTypeFont, width: int) -> list[str]:
    """Wrap text at blanks; cut a word that is wider than a line."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) <= width or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    return [_cut(line, font, width) for line in lines]


def _cut(line: str, font: ImageFont.FreeTypeFont, width: int) -> str:
    while line and font.getlength(line) > width:
        line = line[:-2] + "…"
    return line
