"""Score how human-like a grasp looks, from 1 to 10, with a vision-language model.

The criteria are those of AffordDex; the wording of the prompt is ours.
"""

from __future__ import annotations

from functools import partial
from typing import Protocol

import numpy as np
from PIL import Image, ImageDraw

from afford.common.drawing import font
from afford.common.palette import INK, PAPER
from afford.common.registry import Own
from afford.models.chat import Chat, Endpoint, Question, ask
from afford.surface.describe.prompt import ADVICE, QUOTED, json_objects

WEIGHTS = {"vlm": "a vision-language model with a chat template: folder of save_pretrained, or hub id as llava-hf/llava-1.5-7b-hf"}
SERVER = {"endpoint": "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` "
                      "or none"}  # fmt: skip
MET = {"vlm": "tiny random weights, 2026-11: a LLaVA of transformers with its processor",
       "endpoint": "server of the tests, 2026-11: answers, retries, redirects; no public server"}  # fmt: skip
COLUMNS, LINE_PX = 4, 20
MIN_SCORE, MAX_SCORE = 1.0, 10.0


class Judge(Protocol[Own]):
    """Signature of the backends of this module."""

    def __call__(self, name: str, frames: np.ndarray, seconds: np.ndarray, params: Own) -> float:
        """Score of 1 to 10 for the frames (t, h, w, 3) uint8 of the episode `name`, taken at times (t,) in seconds.

        ValueError in one sentence when there is no model or server, or its answer has no score.
        """


def judge_by_model(name: str, frames: np.ndarray, seconds: np.ndarray, params: Chat) -> float:
    """Score a grasp with a vision-language model on this machine (`Judge`)."""
    return _judge(name, frames, seconds, params)


def judge_by_server(name: str, frames: np.ndarray, seconds: np.ndarray, params: Endpoint) -> float:
    """Score a grasp with a vision-language model behind an OpenAI-compatible server (`Judge`)."""
    return _judge(name, frames, seconds, params)


def _judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Chat | Endpoint) -> float:
    return ask(Question(prompt(len(frames)), contact_sheet(frames, seconds), partial(parse_score, name)), params)


def prompt(count: int) -> str:
    """Prompt that goes with a sheet of `count` frames."""
    return (
        f"The sheet shows {count} moments of one grasp by a robot hand, row by row from left to right, each with its time. The "
        "hand comes down to an object on a table, closes, and lifts it to the green ring.\n"
        "How much does it move as the hand of a person would who does the same? Look at three things:\n"
        "1. Trajectory: is the way to the object and up again short and purposeful, without detours and second tries?\n"
        "2. Smoothness: does the hand gain and lose speed gradually, without jumps between the moments?\n"
        "3. Coordination: do the fingers open and close together, in postures that a person's hand takes, thumb against fingers?\n"
        "Give one mark for all three together: 1 is nothing like a person, 10 cannot be told from one. Whether the object is "
        'lifted does not count.\nAnswer with one JSON object and nothing else: {"score": N}')  # fmt: skip


def contact_sheet(frames: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Sheet (h, w, 3) uint8 of frames (t, h, w, 3), in rows of COLUMNS, each below its time in seconds (t,)."""
    tiles = [np.concatenate([_time_line(frame.shape[1], f"{at:.2f} s"), frame]) for frame, at in zip(frames, seconds, strict=True)]
    tiles += [np.full_like(tiles[0], PAPER)] * (-len(tiles) % COLUMNS)
    return np.concatenate([np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)])


def parse_score(name: str, text: str, backend: str) -> float:
    """Score in an answer; the JSON object may be surrounded by words or a code fence.

    ValueError when the answer has no score or several, or the score is not a number from 1 to 10. Nothing is filled in.
    """
    found = [value["score"] for value in json_objects(text) if "score" in value]
    score = found[0] if len(found) == 1 else None
    if isinstance(score, bool) or not isinstance(score, (int, float)) or not MIN_SCORE <= score <= MAX_SCORE:
        got = repr(score)[:QUOTED] if len(found) == 1 else f"{len(found) or 'none'} in {text[:QUOTED]!r}"
        wanted = "one JSON object with a score from 1 to 10"
        raise ValueError(f"{name}: answer of backend {backend!r}: expected {wanted}, got {got}; {ADVICE}")
    return float(score)


def _time_line(width: int, text: str) -> np.ndarray:
    page = Image.new("RGB", (width, LINE_PX), PAPER)
    ImageDraw.Draw(page).text((4, 2), text, fill=INK, font=font(LINE_PX - 7))
    return np.asarray(page)
