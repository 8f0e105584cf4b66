"""Backbones of the clip and vlm models: `transformers` models from a local folder, their architecture alone, or tiny ones.

A folder of backbones holds `sam/` and `clip/` or `vlm/`, each as `save_pretrained` writes it, with a tokenizer.json in the
latter. A saved two-hand model has the same layout without the weights, which are in its own model.safetensors.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import nn

from afford.models.tokens import HashedTokens, Tokens, read_tokens

TINY_VOCABULARY = 2048


def backbone(kind: Any, folder: str, name: str, tiny: Callable[[], Any], *, pretrained: bool) -> Any:
    """A model of a `transformers` class `kind`: with its weights from folder/name when `pretrained`, else its architecture with
    random weights; of the config that `tiny()` gives when `folder` is ''. Weights become float32, whatever they were saved as.
    ValueError says what could not be read.
    """
    if not folder:
        return kind(tiny())
    place = Path(folder) / name
    if not (place / "config.json").is_file():
        raise ValueError(f"{place}: expected config.json of a {kind.__name__}; set `backbones` to a folder that holds {name}/")
    if not pretrained:
        return kind(kind.config_class.from_pretrained(place)).float()
    try:
        model, report = kind.from_pretrained(
            place, output_loading_info=True, local_files_only=True, use_safetensors=True, dtype=torch.float32)  # fmt: skip
    except OSError as error:
        raise ValueError(f"{place}: expected the weights of a {kind.__name__}; {str(error).splitlines()[0]}") from error
    wrong = sorted(report["missing_keys"]) + sorted(str(key) for key in report["mismatched_keys"])
    if wrong:
        raise ValueError(f"{place}: the weights of {kind.__name__} lack or misshape {', '.join(wrong[:20])}")
    return model


def tokens_of(folder: str, name: str) -> Tokens:
    """folder/name/tokenizer.json, or hashed words when `folder` is ''."""
    return read_tokens(Path(folder) / name / "tokenizer.json") if folder else HashedTokens(TINY_VOCABULARY)


def freeze(module: nn.Module) -> None:
    """No parameter of it is trained."""
    for parameter in module.parameters():
        parameter.requires_grad_(False)
