"""Load a `vlm` of any size: shapes first, then tensors that stay in their files until they are used.

A model in the type in which it is stored needs no memory of its own on a CPU: its pages belong to the files, and the system drops
and reads them again as layer follows layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from torch import Tensor, nn

from afford.models.importing.source import INDEX, shards
from afford.models.loading import WEIGHTS, dtype_of, fill_weights
from afford.models.tensor_files import map_safetensors
from afford.twohands.model.interface import ModelConfig, TwoHands, build

ROOM = 1.1
"""memory of a model and of its answer, as a share of that of its weights"""


def load_large(folder: Path, config: ModelConfig, dtype: str, device: str = "cpu") -> TwoHands:
    """Load a model from its folder (`model_folder.load_model`), on the CPU, to be moved to `device`.

    ValueError names the file or the tensor, or says how much memory is missing, before anything is loaded.
    """
    files = shards(folder / INDEX) if (folder / INDEX).is_file() else [folder / WEIGHTS]
    weights: dict[str, Tensor] = {}
    for file in files:
        try:
            weights |= map_safetensors(file)
        except (OSError, ValueError, SafetensorError) as error:
            raise ValueError(f"{file}: expected the weights of a model as safetensors; {error}") from error
    check_room(weights, dtype, device, str(folder))
    if dtype:
        wanted = dtype_of(dtype)
        weights = {name: tensor.to(wanted) if tensor.is_floating_point() else tensor for name, tensor in weights.items()}
    with torch.device("meta"):
        model = build(config, seed=0, pretrained=False)
    fill_weights(model, weights, str(folder), "it is the file of another model", mapped=True)
    compute_buffers(model)
    return model.eval()


def check_room(weights: Mapping[str, Tensor], dtype: str, device: str, where: str) -> None:
    """Raise ValueError when a model needs more memory than the device has free; mapped weights on a CPU need none."""
    wanted = dtype_of(dtype) if dtype else None
    kept = {name: wanted if wanted and tensor.is_floating_point() else tensor.dtype for name, tensor in weights.items()}
    on_cpu = torch.device(device).type == "cpu"
    own = [name for name in weights if not on_cpu or kept[name] != weights[name].dtype]
    needed, free = ROOM * sum(weights[name].numel() * kept[name].itemsize for name in own), free_bytes(device)
    if free is None or needed <= free:
        return
    smaller = "leave --dtype out: the weights stay in their files" if on_cpu else "use --dtype bfloat16, or --device cpu"
    raise ValueError(f"{where}: it needs {needed / 2**30:.1f} GiB on {device} in {dtype or 'the type of its files'}, and "
                     f"{free / 2**30:.1f} GiB are free; {smaller}")  # fmt: skip


def free_bytes(device: str) -> int | None:
    """Free memory of a device: of a GPU, or of this machine without what it can drop; None where the system does not say."""
    if torch.device(device).type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")), None)


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
