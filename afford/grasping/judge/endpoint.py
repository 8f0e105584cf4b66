"""A vision-language model behind an OpenAI-compatible server as a judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.common.encode import jpeg
from afford.grasping.judge.question import question, read, sheet
from afford.models.chat_endpoint import ask, endpoint

SERVER = "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` or none"
QUALITY = 90


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Any) -> float:
    """Reads what `endpoint` does."""
    picture = jpeg(sheet(frames, seconds), QUALITY).tobytes()
    return read(ask(endpoint(params), question(len(frames)), picture), name, "endpoint")
