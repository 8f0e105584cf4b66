"""Load a `vlm` of any size: shapes first, then tensors that stay in their files until they are used.

A model in the type in which it is stored needs no memory of its own on a CPU: its pages belong to the files, and the system drops
and reads them again as layer follows layer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import torch
from safetensors import SafetensorError
from torch import Tensor, nn

from afford.models.importing.source import INDEX, shards
from afford.models.loading import WEIGHTS, dtype_of, fill_weights
from afford.models.tensor_files import map_safetensors
from afford.twohands.model.frozen_weights import cast_as_computed
from afford.twohands.model.interface import ModelConfig, TwoHands, build
from afford.twohands.model.memory_plan import MemoryPlan, is_large, make_room, plan_prediction
from afford.twohands.model.vlm import Vlm

HALF = ("bfloat16", "float16")


def load_large(folder: Path, config: ModelConfig, dtype: str, device: str = "cpu", pictures: int = 1) -> TwoHands:
    """Load a model from its folder (`model_folder.load_model`), on the CPU, to be moved to `device` for batches of `pictures`.

    ValueError names the file or the tensor, or says how much memory is missing, before anything is loaded.
    """
    model, weights = _described(folder, config)
    if is_large(model):
        planned = plan_weights(model, weights, dtype, device, pictures)
        make_room(planned, device, str(folder), _remedies(model, weights, dtype, device, pictures))
    if dtype:
        wanted = dtype_of(dtype)
        weights = {name: tensor.to(wanted) if tensor.is_floating_point() else tensor for name, tensor in weights.items()}
    fill_weights(model, weights, str(folder), "it is the file of another model", mapped=True)
    compute_buffers(model)
    return model.eval()


def plan_folder(folder: Path, config: ModelConfig, dtype: str, device: str, pictures: int) -> MemoryPlan:
    """Plan predictions of `load_large` with the same arguments; nothing is loaded."""
    return plan_weights(*_described(folder, config), dtype, device, pictures)


def _described(folder: Path, config: ModelConfig) -> tuple[Vlm, dict[str, Tensor]]:
    """A model on the device meta, and its weights, mapped."""
    files = shards(folder / INDEX) if (folder / INDEX).is_file() else [folder / WEIGHTS]
    weights: dict[str, Tensor] = {}
    for file in files:
        try:
            weights |= map_safetensors(file)
        except (OSError, ValueError, SafetensorError) as error:
            raise ValueError(f"{file}: expected the weights of a model as safetensors; {error}") from error
    with torch.device("meta"):
        model = build(config, seed=0, pretrained=False)
    assert isinstance(model, Vlm)
    if len({tensor.dtype for tensor in weights.values()}) > 1:
        cast_as_computed(model)
    return model, weights


def _remedies(model: Vlm, weights: Mapping[str, Tensor], dtype: str, device: str,
              pictures: int) -> list[tuple[str, Callable[[], MemoryPlan]]]:  # fmt: skip
    """Ways to answer with less memory, and their plans."""
    files = "leave --dtype out" + (": the weights stay in their files" if torch.device(device).type == "cpu" else "")
    smaller = [(files, "", device, pictures)] if dtype else []
    smaller += [] if dtype in HALF else [("use --dtype bfloat16", "bfloat16", device, pictures)]
    smaller += [("use --batch 1", dtype, device, 1)] if pictures > 1 else []
    smaller += [("use --dtype bfloat16 and --batch 1", "bfloat16", device, 1)] if pictures > 1 and dtype not in HALF else []
    return [(words, partial(plan_weights, model, weights, kind, where, count)) for words, kind, where, count in smaller]


def plan_weights(model: Vlm, weights: Mapping[str, Tensor], dtype: str, device: str, pictures: int) -> MemoryPlan:
    """Plan for weights used in `dtype`, '' as they are stored; on a CPU, weights of the stored type stay in their files."""
    wanted = dtype_of(dtype) if dtype else None
    for name, parameter in model.named_parameters():
        if name in weights:
            parameter.data = parameter.data.to(wanted or weights[name].dtype)
    on_cpu = torch.device(device).type == "cpu"
    mapped = {name for name, tensor in weights.items() if on_cpu and wanted in (None, tensor.dtype)}
    return plan_prediction(model, device, pictures, frozenset(mapped))


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
