"""Contact sheet of a data set: evenly spaced samples with their masks and captions."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from afford.common.drawing import font
from afford.common.palette import FAINT, INK, LEFT, PAPER, RIGHT
from afford.dataset import masks
from afford.dataset.table_schema import MASKS, PATHS
from schemas.affordance import TAXONOMY

TILE_PX = (456, 256)
BAND_PX = 46
GAP_PX = 8
COLUMNS = 3


def evenly_spaced(total: int, wanted: int) -> list[int]:
    """Return `wanted` indices, evenly spaced over all samples."""
    return sorted({(2 * k + 1) * total // (2 * wanted) for k in range(wanted)}) if total > wanted else list(range(total))


def write_sheet(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write the contact sheet of table rows as PNG."""
    tiles = [draw_tile(row) for row in rows]
    lines = -(-len(tiles) // COLUMNS)
    width, height = TILE_PX[0] + GAP_PX, TILE_PX[1] + BAND_PX + GAP_PX
    sheet = Image.new("RGB", (min(COLUMNS, len(tiles)) * width + GAP_PX, lines * height + GAP_PX), PAPER)
    for n, drawn in enumerate(tiles):
        sheet.paste(drawn, (GAP_PX + n % COLUMNS * width, GAP_PX + n // COLUMNS * height))
    sheet.save(path, optimize=False)


def draw_tile(row: dict[str, Any]) -> Image.Image:
    """Draw one sample: affordances filled, complete objects outlined, motion as a line; left orange, right blue."""
    image = np.asarray(Image.open(io.BytesIO(row["image"]["bytes"])).convert("RGB"))
    planes = masks.decode_rle([row[f"{name}_rle"] for name in MASKS], *image.shape[:2])
    drawn = Image.new("RGB", (TILE_PX[0], TILE_PX[1] + BAND_PX), PAPER)
    drawn.paste(_fit_tile(draw_overlay(image, planes, [row["motion"][name] for name in PATHS])))
    _caption(ImageDraw.Draw(drawn), row)
    return drawn


def draw_overlay(image: np.ndarray, planes: np.ndarray, motion: Sequence[Sequence[Sequence[float]]]) -> np.ndarray:
    """Draw masks (4, h, w) and the four paths of points into a copy of an RGB image."""
    out = image.copy()
    for colour, affordance in zip((LEFT, RIGHT), planes[:2], strict=True):
        out[affordance] = (0.35 * out[affordance] + 0.65 * np.array(colour)).astype(np.uint8)
    for colour, plane in zip((LEFT, RIGHT), planes[2:], strict=True):
        outlines, _ = cv2.findContours(plane.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, outlines, -1, (255, 255, 255), 2, cv2.LINE_AA)
        cv2.drawContours(out, outlines, -1, colour, 1, cv2.LINE_AA)
    for colour, path in zip((LEFT, RIGHT), motion[2:], strict=True):
        points = np.array([point for point in path if np.isfinite(point).all()]).reshape(-1, 1, 2)
        cv2.polylines(out, [np.rint(points).astype(np.int32)], False, (255, 255, 255), 3, cv2.LINE_AA)
        cv2.polylines(out, [np.rint(points).astype(np.int32)], False, colour, 2, cv2.LINE_AA)
    return out


def _fit_tile(image: np.ndarray) -> Image.Image:
    """Scale an image into a tile, centred on black."""
    scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    drawn = Image.new("RGB", TILE_PX)
    drawn.paste(Image.fromarray(image).resize(size), ((TILE_PX[0] - size[0]) // 2, (TILE_PX[1] - size[1]) // 2))
    return drawn


def _caption(draw: ImageDraw.ImageDraw, row: dict[str, Any]) -> None:
    top = TILE_PX[1] + 4
    draw.text((2, top), _shorten(draw, row["narration"], font(15, bold=True), TILE_PX[0] - 4), INK, font(15, bold=True))
    facts = f"{TAXONOMY[row['taxonomy']].replace('_', ' ')}  \u00b7  quality {row['quality']:.2f}  \u00b7  {row['sample_id']}"
    draw.text((2, top + 21), _shorten(draw, facts, font(12), TILE_PX[0] - 120), FAINT, font(12))
    for colour, name, x in ((LEFT, row["object_left"], TILE_PX[0] - 112), (RIGHT, row["object_right"], TILE_PX[0] - 55)):
        if name:
            draw.rectangle((x, top + 24, x + 8, top + 32), colour)
            draw.text((x + 11, top + 21), _shorten(draw, name, font(12), 44), INK, font(12))


def _shorten(draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont, width: int) -> str:
    """Shorten a text to one line of `width` pixels."""
    text = " ".join(text[:400].split())
    if draw.textlength(text, font) <= width:
        return text
    while text and draw.textlength(text + "\u2026", font) > width:
        text = text[:-1]
    return text + "\u2026"
