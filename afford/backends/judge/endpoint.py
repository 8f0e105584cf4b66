"""A vision-language model behind an OpenAI-compatible server as a judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.backends.judge.question import question, read, sheet
from afford.encode import jpeg
from afford.models.chat_endpoint import Endpoint, ask

QUALITY = 90


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Any) -> float:
    """Reads `url`, `model`, `key_variable`, `timeout_s`, `retries`, `pause_s`, `seed` and `new_tokens`."""
    server = Endpoint(params.url, params.model, params.key_variable, params.timeout_s, params.retries, params.pause_s, params.seed,
                      params.new_tokens)  # fmt: skip
    picture = jpeg(sheet(frames, seconds), QUALITY).tobytes()
    return read(ask(server, question(len(frames)), picture), name, "endpoint")
