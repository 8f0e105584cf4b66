"""A local vision-language model as a judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.backends.judge.question import question, read, sheet
from afford.models.chat_model import load_model, reply


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Any) -> float:
    """Reads `model` and `new_tokens`."""
    return read(reply(load_model(params.model), question(len(frames)), sheet(frames, seconds), params.new_tokens), name, "vlm")
