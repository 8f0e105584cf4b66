"""A vision-language model of `transformers` that is shown one picture and asked one question; the likeliest word is always taken.

Whatever `AutoModelForImageTextToText` and `AutoProcessor` know, with a chat template. Those whose processor needs torchvision (as
the ones that also read video do) cannot be used beside the pinned torch; a server can run them (chat_endpoint.py).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from PIL import Image
from transformers import AutoModelForImageTextToText, AutoProcessor
from transformers.utils import logging

from afford.models.loading import ERRORS, check_loading, device_of, dtype_of, first_line, local_path
from afford.models.weights import file_stamps

UNUSED = dict.fromkeys(("temperature", "top_p", "top_k"))
"""settings of sampling that a model may come with: nothing is sampled"""


class ChatModel(NamedTuple):
    """A model and what turns words and pictures into its inputs."""

    model: Any
    processor: Any


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> ChatModel:
    """From a local folder, weights in safetensors only, for inference; ValueError says what was tried. The last one is kept, since
    a process asks about many objects.
    """
    where = local_path(name, "vlm", "vision-language model with its processor")
    return _kept(where, file_stamps(where), device_of(device), dtype_of(dtype))


@lru_cache(maxsize=1)
def _kept(where: Path, stamped: Any, device: torch.device, dtype: torch.dtype) -> ChatModel:
    logging.disable_progress_bar()  # a stage prints nothing; the runner shows what goes on
    try:
        processor = AutoProcessor.from_pretrained(where, local_files_only=True)
        model, report = AutoModelForImageTextToText.from_pretrained(
            where, use_safetensors=True, local_files_only=True, dtype=dtype, output_loading_info=True)  # fmt: skip
    except (*ERRORS, ImportError) as error:
        wanted = "a vision-language model with its processor"
        raise ValueError(f"model {str(where)!r}: expected {wanted}; {first_line(error)}") from error
    if not getattr(processor, "image_processor", None) or not getattr(processor, "chat_template", None):
        got = type(processor).__name__
        raise ValueError(f"model {str(where)!r}: expected a processor of pictures with a chat template, got {got}")
    # Published models carry buffers of older versions, so unexpected keys are ignored.
    check_loading({**report, "unexpected_keys": ()}, "vision-language model", str(where))
    return ChatModel(model.to(device).eval(), processor)


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
