"""Vision-language models of `transformers`, run on this machine with greedy decoding.

Any model that `AutoModelForImageTextToText` and `AutoProcessor` load, with a chat template. A model whose processor needs
torchvision, such as one that also reads video, cannot be loaded beside the pinned torch; serve it with a server (chat_endpoint.py).
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

from afford.models.chat import Chat
from afford.models.loading import ERRORS, check_loading, device_of, dtype_of, first_line, local_path
from afford.models.weights import file_stamps

NO_SAMPLING = dict.fromkeys(("temperature", "top_p", "top_k"))
"""sampling settings of a model that greedy decoding does not use"""


class ChatModel(NamedTuple):
    """A model, and the processor that turns text and pictures into its inputs."""

    model: Any
    processor: Any


def answer(prompt: str, rgb: np.ndarray, params: Chat) -> str:
    """Answer of the model to a prompt about a picture (h, w, 3) uint8 RGB. ValueError, one sentence, when it cannot be loaded."""
    return generate(load_model(params.model, params.device, params.dtype), prompt, rgb, params.new_tokens)


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> ChatModel:
    """Load a model for inference from a local folder with safetensors weights.

    The last model stays in memory, because one process asks about many pictures. ValueError says what cannot be used.
    """
    where = local_path(name, "vlm", "vision-language model with its processor")
    return _load_cached(where, file_stamps(where), device_of(device), dtype_of(dtype))


@lru_cache(maxsize=1)
def _load_cached(where: Path, stamps: Any, device: torch.device, dtype: torch.dtype) -> ChatModel:
    logging.disable_progress_bar()  # a stage prints nothing; the runner shows the progress
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
def generate(chat: ChatModel, prompt: str, rgb: np.ndarray, new_tokens: int) -> str:
    """Text that a model generates for a prompt about a picture (h, w, 3) uint8, at most `new_tokens` tokens."""
    given = inputs(chat, prompt, rgb).to(chat.model.device, chat.model.dtype)
    ids = chat.model.generate(**given, max_new_tokens=new_tokens, do_sample=False, num_beams=1, **NO_SAMPLING)
    text: str = chat.processor.decode(ids[0, given["input_ids"].shape[1] :], skip_special_tokens=True)
    return text


def inputs(chat: ChatModel, prompt: str, rgb: np.ndarray) -> Any:
    """Model inputs for the picture and the prompt as one user turn, in the model's own chat template."""
    content = [{"type": "image", "image": Image.fromarray(rgb)}, {"type": "text", "text": prompt}]
    conversation = [{"role": "user", "content": content}]
    options = {"add_generation_prompt": True, "tokenize": True, "return_dict": True, "return_tensors": "pt"}
    return chat.processor.apply_chat_template(conversation, **options)
