"""Load a `vlm` of any size: shapes first, then tensors that stay in their files until they are used.

A model in the type in which it is stored needs no memory of its own on a CPU: its pages belong to the files, and the system drops
and reads them again as layer follows layer.
"""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors import SafetensorError
from torch import Tensor, nn

from afford.models.importing.source import INDEX, shards
from afford.models.loading import WEIGHTS, dtype_of, fill_weights
from afford.models.tensor_files import map_safetensors
from afford.twohands.model.interface import ModelConfig, TwoHands, build


def load_large(folder: Path, config: ModelConfig, dtype: str) -> TwoHands:
    """Load a model from its folder (`model_folder.load_model`). ValueError names the file or the tensor."""
    files = shards(folder / INDEX) if (folder / INDEX).is_file() else [folder / WEIGHTS]
    weights: dict[str, Tensor] = {}
    for file in files:
        try:
            weights |= map_safetensors(file)
        except (OSError, ValueError, SafetensorError) as error:
            raise ValueError(f"{file}: expected the weights of a model as safetensors; {error}") from error
    if dtype:
        wanted = dtype_of(dtype)
        weights = {name: tensor.to(wanted) if tensor.is_floating_point() else tensor for name, tensor in weights.items()}
    with torch.device("meta"):
        model = build(config, seed=0, pretrained=False)
    fill_weights(model, weights, str(folder), "it is the file of another model", mapped=True)
    compute_buffers(model)
    return model.eval()


def compute_buffers(model: nn.Module) -> None:
    """Compute the buffers that no file holds, for a model that was built on the device meta. RuntimeError for an unknown one."""
    for module in model.modules():
        missing = {name: buffer for name, buffer in module.named_buffers(recurse=False) if buffer.is_meta}
        if "position_ids" in missing:
            ids = missing.pop("position_ids")
            module.register_buffer("position_ids", torch.arange(ids.shape[-1]).expand(ids.shape).clone(), persistent=False)
        if "inv_freq" in missing:
            fresh = type(module)(module.config)  # type: ignore[call-arg, arg-type]  # rotary positions of a language model
            for name in list(missing):
                module.register_buffer(name, fresh.get_buffer(name), persistent=False)
                del missing[name]
        if missing:
            raise RuntimeError(f"{type(module).__name__}: no rule computes {', '.join(missing)}")
