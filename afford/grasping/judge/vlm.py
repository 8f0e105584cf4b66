"""A local vision-language model as a judge."""

from __future__ import annotations

import numpy as np

from afford.grasping.judge.question import question, read, sheet
from afford.models.chat import Chat
from afford.models.chat_model import load_model, reply

WEIGHTS = "a vision-language model with a chat template: folder of save_pretrained, or hub id as llava-hf/llava-1.5-7b-hf"


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Chat) -> float:
    """See `Judge`."""
    model = load_model(params.model, params.device, params.dtype)
    return read(reply(model, question(len(frames)), sheet(frames, seconds), params.new_tokens), name, "vlm")
