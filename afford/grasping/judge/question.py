"""What a judge is shown and asked, and how its answer is read. The criteria are AffordDex's, the words are ours."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from afford.common.drawing import font
from afford.common.palette import INK, PAPER
from afford.surface.describe.answer import ADVICE, QUOTED, objects

COLUMNS, LINE_PX = 4, 20
LEAST, MOST = 1.0, 10.0


def question(count: int) -> str:
    """The text beside a sheet of `count` frames."""
    return (
        f"The sheet shows {count} moments of one grasp by a robot hand, row by row from left to right, each with its time. The "
        "hand comes down to an object on a table, closes, and lifts it to the green ring.\n"
        "How much does it move as the hand of a person would who does the same? Look at three things:\n"
        "1. Trajectory: is the way to the object and up again short and purposeful, without detours and second tries?\n"
        "2. Smoothness: does the hand gain and lose speed gradually, without jumps between the moments?\n"
        "3. Coordination: do the fingers open and close together, in postures that a person's hand takes, thumb against fingers?\n"
        "Give one mark for all three together: 1 is nothing like a person, 10 cannot be told from one. Whether the object is "
        'lifted does not count.\nAnswer with one JSON object and nothing else: {"score": N}')  # fmt: skip


def sheet(frames: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8: frames (t, h, w, 3) in rows of COLUMNS, each under its time."""
    tiles = [np.concatenate([_line(frame.shape[1], f"{at:.2f} s"), frame]) for frame, at in zip(frames, seconds, strict=True)]
    tiles += [np.full_like(tiles[0], PAPER)] * (-len(tiles) % COLUMNS)
    return np.concatenate([np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)])


def read(text: str, name: str, backend: str) -> float:
    """The score in an answer, which may have words or a fence around its JSON; ValueError when there is none, or more than one, or
    it is no number from 1 to 10. Nothing is filled in.
    """
    found = [value["score"] for value in objects(text) if "score" in value]
    score = found[0] if len(found) == 1 else None
    if isinstance(score, bool) or not isinstance(score, (int, float)) or not LEAST <= score <= MOST:
        got = repr(score)[:QUOTED] if found[1:] == [] and found else f"{len(found) or 'none'} in {text[:QUOTED]!r}"
        wanted = "one JSON object with a score from 1 to 10"
        raise ValueError(f"{name}: answer of backend {backend!r}: expected {wanted}, got {got}; {ADVICE}")
    return float(score)


def _line(width: int, words: str) -> np.ndarray:
    page = Image.new("RGB", (width, LINE_PX), PAPER)
    ImageDraw.Draw(page).text((4, 2), words, fill=INK, font=font(LINE_PX - 7))
    return np.asarray(page)
