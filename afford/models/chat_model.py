"""A vision-language model of `transformers` that is shown one picture and asked one question; the likeliest word is always taken.

Whatever `AutoModelForImageTextToText` and `AutoProcessor` know, with a chat template. Those whose processor needs torchvision (as
the ones that also read video do) cannot be used beside the pinned torch; a server can run them (chat_endpoint.py).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from PIL import Image
from transformers import AutoModelForImageTextToText, AutoProcessor
from transformers.utils import logging

UNUSED = dict.fromkeys(("temperature", "top_p", "top_k"))
"""settings of sampling that a model may come with: nothing is sampled"""


class ChatModel(NamedTuple):
    """A model and what turns words and pictures into its inputs."""

    model: Any
    processor: Any


@lru_cache(maxsize=1)
def load_model(name: str) -> ChatModel:
    """From a local folder or a hub id, weights in safetensors only, on the best device here; ValueError says what was tried. The
    last one is kept, since a process asks about many objects."""
    if not name:
        raise ValueError("backend 'vlm' needs a model: set `model` to a local folder or a hub id of a vision-language model")
    logging.disable_progress_bar()  # a stage prints nothing; the runner shows what goes on
    try:
        processor = AutoProcessor.from_pretrained(name)
        model, report = AutoModelForImageTextToText.from_pretrained(
            name, use_safetensors=True, dtype="auto", output_loading_info=True)  # fmt: skip
    except (OSError, ValueError, ImportError) as error:
        raise ValueError(f"model {name!r}: expected a vision-language model with its processor; {_first(error)}") from error
    if not getattr(processor, "image_processor", None) or not getattr(processor, "chat_template", None):
        raise ValueError(f"model {name!r}: expected a processor of pictures with a chat template, got {type(processor).__name__}")
    if report["missing_keys"]:
        raise ValueError(f"model {name!r}: the weights lack {', '.join(sorted(report['missing_keys'])[:8])}")
    return ChatModel(model.to("cuda" if torch.cuda.is_available() else "cpu").eval(), processor)


@torch.inference_mode()
def reply(chat: ChatModel, text: str, rgb: np.ndarray, new_tokens: int) -> str:
    """What the model says about a picture (h, w, 3) uint8 when it is asked `text`, `new_tokens` at most."""
    asked = inputs(chat, text, rgb).to(chat.model.device, chat.model.dtype)
    said = chat.model.generate(**asked, max_new_tokens=new_tokens, do_sample=False, num_beams=1, **UNUSED)
    words: str = chat.processor.decode(said[0, asked["input_ids"].shape[1] :], skip_special_tokens=True)
    return words


def inputs(chat: ChatModel, text: str, rgb: np.ndarray) -> Any:
    """The picture and the question as one turn of a conversation, in the model's own template."""
    content = [{"type": "image", "image": Image.fromarray(rgb)}, {"type": "text", "text": text}]
    talk = [{"role": "user", "content": content}]
    wanted = {"add_generation_prompt": True, "tokenize": True, "return_dict": True, "return_tensors": "pt"}
    return chat.processor.apply_chat_template(talk, **wanted)


def _first(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
