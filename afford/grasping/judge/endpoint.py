"""A vision-language model behind an OpenAI-compatible server as a judge."""

from __future__ import annotations

import numpy as np

from afford.common.image_files import encode_jpeg
from afford.grasping.judge.question import question, read, sheet
from afford.models.chat import Endpoint
from afford.models.chat_endpoint import ask

SERVER = "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` or none"
QUALITY = 90


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Endpoint) -> float:
    """See `Judge`."""
    picture = encode_jpeg(sheet(frames, seconds), QUALITY).tobytes()
    return read(ask(params, question(len(frames)), picture), name, "endpoint")
