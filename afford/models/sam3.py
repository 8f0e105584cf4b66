"""Segment Anything 3 (Carion et al. 2025) prompted with phrases, through `transformers.Sam3Model`.

The published files are those of the video model, of which only the detector is loaded. Its own processor needs a package that does
not work beside the pinned torch, so pictures are scaled and normalised here: stretched to a square, mean and deviation 0.5.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate
from transformers import Sam3Model

from afford.models.loading import ERRORS, check_loading, first_line, load_cached, local_path
from afford.models.tokens import Tokens, read_tokens, tokenize_batch

KINDS = ("sam3", "sam3_video")
LEFT_OUT = "tracker_"
"""prefix of the tensors of the video tracker, which are not loaded"""


@dataclass(frozen=True)
class Concepts:
    """Model and tokenizer."""

    model: Sam3Model
    tokens: Tokens


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> Concepts:
    """Load a model from a local folder, for inference. ValueError, one sentence, for no model or another kind of model."""
    model: Sam3Model = load_cached(_read, Sam3Model, name, "sam3", device, dtype)
    return Concepts(model, read_tokens(local_path(name, "sam3", "Sam3Model") / "tokenizer.json"))


def _read(kind: Any, where: Path) -> Sam3Model:
    try:
        kind_found = json.loads((where / "config.json").read_text(encoding="utf-8")).get("model_type")
        if kind_found not in KINDS:
            raise ValueError(f"config.json has model_type {kind_found!r}")
        model, report = kind.from_pretrained(where, output_loading_info=True, local_files_only=True, use_safetensors=True,
                                             dtype=torch.float32)  # fmt: skip
    except (*ERRORS, AttributeError) as error:
        raise ValueError(f"model {str(where)!r}: expected the weights of a Sam3Model; {first_line(error)}") from error
    unexpected = [key for key in report["unexpected_keys"] if not key.startswith(LEFT_OUT)]
    check_loading(report | {"unexpected_keys": unexpected}, "Sam3Model", str(where))
    return model  # type: ignore[no-any-return]  # what from_pretrained gives


@torch.inference_mode()
def concept_probabilities(found: Concepts, rgb: np.ndarray, phrases: Sequence[str], threshold: float) -> np.ndarray:
    """Probability (p, n, h, w) float32 that a pixel of pictures (n, h, w, 3) uint8 shows the concept of each of p phrases.

    threshold: least score of an instance.
    """
    model, size = found.model, rgb.shape[1:3]
    seen = model.get_vision_features(_squares(model, rgb))
    ids, keep = (part.to(model.device) for part in tokenize_batch(found.tokens, model.config.text_config, phrases))
    return np.stack([_one(model, seen, row[None].expand(len(rgb), -1), mask[None].expand(len(rgb), -1), size, threshold)
                     for row, mask in zip(ids, keep, strict=True)])  # fmt: skip


def _squares(model: Sam3Model, rgb: np.ndarray) -> Tensor:
    side = int(model.config.image_size)
    image = torch.from_numpy(rgb).permute(0, 3, 1, 2).float().to(model.device) / 255
    square = interpolate(image, (side, side), mode="bilinear", align_corners=False, antialias=True)
    return ((square - 0.5) / 0.5).to(model.dtype)


def _one(model: Sam3Model, seen: Any, ids: Tensor, keep: Tensor, size: tuple[int, ...], threshold: float) -> np.ndarray:
    """Largest probability of an instance at every pixel, (n, h, w)."""
    output = model(vision_embeds=seen, input_ids=ids, attention_mask=keep)
    score = output.pred_logits.float().sigmoid() * output.presence_logits.float().sigmoid()
    masks = output.pred_masks.float().sigmoid() * (score >= threshold)[..., None, None]
    most = masks.amax(1, keepdim=True)
    return interpolate(most, tuple(size), mode="bilinear", align_corners=False)[:, 0].cpu().numpy()
