"""Contact sheets of the best, median and worst cases: predictions filled, truth outlined; left orange, right blue."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from afford.common.image_files import encode_jpeg
from afford.common.palette import INK, LEFT, PAPER, RIGHT, Colour
from afford.twohands.benchmark import cases
from afford.twohands.benchmark.answers import Answer
from schemas.benchmark import Case, Sheet

TILE_PX, BAND_PX, GAP_PX = 260, 42, 6
PER_ROW = 4
JPEG_QUALITY = 88
LINES = ("best", "median", "worst")


def pick(scores: np.ndarray, count: int = PER_ROW) -> tuple[list[int], list[int], list[int]]:
    """Positions of the best, median and worst cases by score; equal scores keep their order."""
    order = np.argsort(-scores, kind="stable").tolist()
    middle = max((len(order) - count) // 2, 0)
    return order[:count], order[middle : middle + count], order[-count:][::-1]


def draw(protocol: str, chosen: Sequence[Sequence[tuple[Case, Answer, float]]]) -> Sheet:
    """Draw three lines of (case, answer, IoU) as one sheet."""
    width, height = PER_ROW * (TILE_PX + GAP_PX) + GAP_PX, TILE_PX + BAND_PX + GAP_PX
    sheet = np.full((len(LINES) * (height + 20), width, 3), PAPER, np.uint8)
    for line, (title, row) in enumerate(zip(LINES, chosen, strict=True)):
        top = line * (height + 20)
        _text(sheet, f"{title} by IoU", (GAP_PX, top + 15), 0.5)
        for n, (case, answer, iou) in enumerate(row):
            x, y = GAP_PX + n * (TILE_PX + GAP_PX), top + 20
            sheet[y : y + TILE_PX + BAND_PX, x : x + TILE_PX] = tile(case, answer, iou)
    return Sheet(protocol, encode_jpeg(sheet, JPEG_QUALITY))


def tile(case: Case, answer: Answer, iou: float) -> np.ndarray:
    """Draw one case: (TILE_PX + BAND_PX, TILE_PX, 3) uint8 RGB."""
    height, width = case.modes.shape[2:]
    scale = TILE_PX / max(height, width)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    image = cv2.resize(cases.image(case), size, interpolation=cv2.INTER_AREA)
    for colour, found in zip((LEFT, RIGHT), answer.top, strict=True):
        small = cases.resize_mask(np.ascontiguousarray(found), size[::-1])
        image[small] = (0.4 * image[small] + 0.6 * np.array(colour)).astype(np.uint8)
    for colour, truth in ((c, m) for mode in case.modes[::-1] for c, m in zip((LEFT, RIGHT), mode, strict=True)):
        _outline(image, cases.resize_mask(truth, size[::-1]), colour)
    out = np.full((TILE_PX + BAND_PX, TILE_PX, 3), PAPER, np.uint8)
    left, top = (TILE_PX - size[0]) // 2, (TILE_PX - size[1]) // 2
    out[top : top + size[1], left : left + size[0]] = image
    _text(out, f"{iou:.2f}  {case.task}", (2, TILE_PX + 15), 0.42)
    _text(out, f"{case.video}/{case.frame}" + (f"  {len(case.modes)} ways" if len(case.modes) > 1 else ""), (2, TILE_PX + 33), 0.36)
    return out


def sheets(ids: Sequence[str], scores: np.ndarray, fetch: Callable[[str], tuple[Case, Answer]]) -> tuple[Sheet, ...]:
    """Draw one sheet for each protocol, from the ids of cases and their IoU."""
    out = []
    for protocol in dict.fromkeys(name.partition("/")[0] for name in ids):
        mine = [n for n, name in enumerate(ids) if name.startswith(f"{protocol}/")]
        lines = [[(*fetch(ids[mine[n]]), float(scores[mine[n]])) for n in line] for line in pick(scores[mine])]
        out.append(draw(protocol, lines))
    return tuple(out)


def _outline(image: np.ndarray, mask: np.ndarray, colour: Colour) -> None:
    outlines, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, outlines, -1, (255, 255, 255), 2, cv2.LINE_AA)
    cv2.drawContours(image, outlines, -1, colour, 1, cv2.LINE_AA)


def _text(image: np.ndarray, text: str, at: tuple[int, int], scale: float) -> None:
    cv2.putText(image, text.encode("ascii", "replace").decode(), at, cv2.FONT_HERSHEY_SIMPLEX, scale, INK, 1, cv2.LINE_AA)
