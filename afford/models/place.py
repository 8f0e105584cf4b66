"""Where a network runs, and in which type, from the words of Params."""

from __future__ import annotations

import torch

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}


def device_of(name: str) -> torch.device:
    """"auto" is the GPU if there is one. ValueError for a device that is not here."""
    gpu = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if gpu else "cpu")
    if name != "cpu" and not (name.partition(":")[0] == "cuda" and gpu):
        raise ValueError(f"device: expected auto, cpu{', cuda or cuda:N' if gpu else ' (there is no GPU here)'}, got {name!r}")
    return torch.device(name)


def dtype_of(name: str) -> torch.dtype:
    """ValueError for a type that networks do not run in."""
    if name not in DTYPES:
        raise ValueError(f"dtype: expected {', '.join(DTYPES)}, got {name!r}")
    return DTYPES[name]
