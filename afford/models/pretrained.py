"""Models of `transformers` from files on this machine: every tensor must be there and fit, and nothing is fetched."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError

from afford.models.weights import stamp

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
SHOWN = 8
"""tensors that are named when they do not fit"""
ERRORS = (OSError, ValueError, RuntimeError, TypeError, KeyError, SafetensorError)
"""what `from_pretrained` raises for files that are missing, cut short or of something else"""


def pretrained(kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """A model of the class `kind` from a local folder, for inference on `device` in `dtype`; the last one is kept in memory.

    ValueError in one sentence: no name, no such folder, another model, a tensor that is missing, left over or misshapen.
    """
    return kept(read, kind, name, backend, device, dtype)


def kept(reader: Callable[[Any, Path], Any], kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """As `pretrained`, with a reader of one's own: (class, folder or file) -> model on the CPU."""
    where = place(name, backend, kind.__name__)
    return _kept(reader, kind, where, stamp(where), device_of(device), dtype_of(dtype))


def place(name: str, backend: str, what: str) -> Path:
    """The folder or file that a stage was given. ValueError when it is not there."""
    if not name:
        raise ValueError(f"backend {backend!r} needs a model: set `model` to a local folder or a hub id of a {what}")
    if not Path(name).exists():
        raise ValueError(f"model {name!r}: expected a {what} in a local folder, got nothing there; check the path, or let "
                         "`pipeline.py run --set STAGE.model=HUB_ID` find a hub id")
    return Path(name)


@lru_cache(maxsize=1)
def _kept(reader: Callable[[Any, Path], Any], kind: Any, where: Path, stamped: Any, device: torch.device,
          dtype: torch.dtype) -> Any:  # fmt: skip
    return reader(kind, where).to(device=device, dtype=dtype).eval()


def read(kind: Any, where: Path) -> Any:
    """A model of the class `kind` on the CPU, in float32. ValueError names what does not fit."""
    _of_kind(kind, where)
    try:
        model, report = kind.from_pretrained(where, output_loading_info=True, local_files_only=True, use_safetensors=True,
                                             dtype=torch.float32)  # fmt: skip
    except ERRORS as error:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__}; {first(error)}") from error
    fit(report, kind.__name__, str(where))
    return model


def _of_kind(kind: Any, where: Path) -> None:
    """ValueError when the config is not one of this kind of model; nothing is built from it to find that out."""
    wanted = kind.config_class.model_type
    try:
        config = json.loads((where / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        said = f"model {str(where)!r}: expected config.json of a {kind.__name__} in this folder; {first(error)}"
        raise ValueError(said) from error
    got = config.get("model_type") if isinstance(config, dict) else type(config).__name__
    if got != wanted:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__} (model_type {wanted}), got {got}")


def fit(report: dict[str, Any], what: str, where: str) -> None:
    """ValueError that names tensors which are missing, misshapen or left over."""
    for key, said in (("missing_keys", "lack"), ("mismatched_keys", "have other shapes in"), ("unexpected_keys", "have besides")):
        names = sorted(str(name[0] if isinstance(name, tuple) else name) for name in report[key])
        if names:
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            raise ValueError(f"model {where!r}: expected the weights of a {what}, these {said} {', '.join(names[:SHOWN])}{more}; "
                             "it is another model, or its files are not whole")


def first(error: BaseException) -> str:
    """The first line of what an error says that is not empty."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)


def device_of(name: str) -> torch.device:
    """cpu, cuda or cuda:N; ValueError when it is not here."""
    if name.partition(":")[0] == "cuda" and not torch.cuda.is_available():
        raise ValueError(f"device {name!r}: expected a CUDA GPU, got none on this machine; set device to cpu")
    try:
        return torch.device(name)
    except RuntimeError as error:
        raise ValueError(f"device {name!r}: expected cpu, cuda or cuda:N") from error


def dtype_of(name: str) -> torch.dtype:
    """One of DTYPES; ValueError for another name."""
    if name not in DTYPES:
        raise ValueError(f"dtype {name!r}: expected one of {', '.join(DTYPES)}")
    return DTYPES[name]
