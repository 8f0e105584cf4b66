"""Contact sheet of grasps, a row of key frames for each episode, and a video of several episodes in a grid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from afford.common.drawing import font
from afford.common.image_files import encode_png
from afford.common.palette import FAINT, INK, PAPER, Colour
from afford.common.video.frames import write_video
from afford.grasping.env.measures import TOUCH_N
from afford.grasping.env.rendering import DrawableEpisode
from afford.grasping.evaluate.trace_metrics import PHASES, key_frames, trace_metrics

WORDS_PX, HEAD_PX, GAP_PX, LETTERS_PX = 190, 30, 4, 15
BAD: Colour = (190, 40, 36)
GOOD: Colour = (20, 120, 70)
SHADE: Colour = (70, 72, 76)
CRF = 23
STILL_S = 0.8
"""time that the last frame of a video stays"""


def sheet(rows: Mapping[str, DrawableEpisode]) -> np.ndarray:
    """Draw the sheet (h, w, 3) uint8: label -> episode, with a column for each of `PHASES`; ValueError without episodes."""
    if not rows:
        raise ValueError("rows: no episodes to show")
    strips = [_strip(label, one) for label, one in rows.items()]
    step = (strips[0].shape[1] - WORDS_PX) // len(PHASES)
    head = _page(strips[0].shape[1], HEAD_PX, [(WORDS_PX + k * step + 6, 6, name, INK) for k, name in enumerate(PHASES)])
    return np.concatenate([head, *strips])


def write_sheet(path: Path, rows: Mapping[str, DrawableEpisode]) -> None:
    """Write `sheet` as a PNG."""
    path.write_bytes(encode_png(cv2.cvtColor(sheet(rows), cv2.COLOR_RGB2BGR)).tobytes())


def write_film(path: Path, rows: Mapping[str, DrawableEpisode], columns: int = 3) -> None:
    """Write all episodes in a grid as an MP4, at their own rate; finished episodes stay on their last frame.

    ValueError without episodes, or for traces of different rates.
    """
    rates = {one.trace.rate_hz for one in rows.values()}
    if len(rates) != 1:
        raise ValueError(f"rows: expected episodes of one rate, got {sorted(rates) or 'none'}")
    write_video(path, _frames(rows, columns, round(STILL_S * min(rates))), CRF, round(min(rates)))


def _frames(rows: Mapping[str, DrawableEpisode], columns: int, still: int) -> Iterator[np.ndarray]:
    words = [(label, one, trace_metrics(one.trace, one.task).success) for label, one in rows.items()]
    longest = max(len(one.trace.q) for one in rows.values())
    wide = min(columns, len(words))
    for row in (*range(longest), *[longest - 1] * still):
        tiles = [_tile(label, one, min(row, len(success) - 1), success) for label, one, success in words]
        tiles += [np.full_like(tiles[0], PAPER)] * (-len(tiles) % wide)
        yield _even(np.concatenate([np.concatenate(tiles[k : k + wide], axis=1) for k in range(0, len(tiles), wide)]))


def _strip(label: str, one: DrawableEpisode) -> np.ndarray:
    """Draw a row: its label and verdict, then the key frames."""
    tiles = [cv2.copyMakeBorder(one.draw(row), 0, GAP_PX, 0, GAP_PX, cv2.BORDER_CONSTANT, value=PAPER)
             for row in key_frames(one.trace, one.task)]  # fmt: skip
    lines = [(label, INK), (one.trace.task, FAINT), *_verdict(one)]
    words = _page(WORDS_PX, tiles[0].shape[0], [(8, 10 + 22 * k, text, colour) for k, (text, colour) in enumerate(lines)])
    return np.concatenate([words, *tiles], axis=1)


def _verdict(one: DrawableEpisode) -> list[tuple[str, Colour]]:
    """Return the verdict of an episode by the metrics, as lines of text."""
    how, trace = trace_metrics(one.trace, one.task), one.trace
    pressed = bool((trace.force_negative[-1] > TOUCH_N).any())
    return [("reached the goal" if how.success[-1] else "never at the goal", GOOD if how.success[-1] else BAD),
            (f"{how.as_violation_pct[-1]:.0f} % of fingertips unsafe", BAD if how.as_violation_pct[-1] else GOOD),
            ("presses on a negative part" if pressed else "off negative parts", BAD if pressed else GOOD),
            (f"{1000 * trace.penetration_m.max():.1f} mm deep at most", FAINT)]  # fmt: skip


def _tile(label: str, one: DrawableEpisode, row: int, success: np.ndarray) -> np.ndarray:
    """Draw a step with its label, its task, and a mark when the goal was reached."""
    page = Image.fromarray(one.draw(row))
    draw = ImageDraw.Draw(page)
    draw.text((6, 4), label, fill=INK, font=font(LETTERS_PX))
    draw.text((6, 24), one.trace.task, fill=SHADE, font=font(LETTERS_PX - 3))
    if success[row]:
        draw.text((6, page.height - LETTERS_PX - 8), "reached the goal", fill=GOOD, font=font(LETTERS_PX, bold=True))
    return np.asarray(page)


def _page(width: int, height: int, words: Sequence[tuple[int, int, str, Colour]]) -> np.ndarray:
    """Draw text at (x, y); text that does not fit ends with dots."""
    page = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(page)
    for x, y, text, colour in words:
        draw.text((x, y), _fitting(text, width - x), fill=colour, font=font(LETTERS_PX - 2))
    return np.asarray(page)


def _fitting(text: str, width: int) -> str:
    letters = font(LETTERS_PX - 2)
    if letters.getlength(text) <= width:
        return text
    return next(f"{text[:k]}…" for k in range(len(text) - 1, -1, -1) if letters.getlength(f"{text[:k]}…") <= width or not k)


def _even(picture: np.ndarray) -> np.ndarray:
    """Crop to even width and height, as H.264 requires."""
    return picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
