"""Weights into a model, tensor by tensor, or one sentence that says which do not fit."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from afford.common.bounded import reason
from afford.models.weights import file_stamps

NAMED = 8
"""tensors that the sentence names before it only counts"""
LONGEST = 360
"""characters that their names and shapes may take"""


def fill_weights(model: nn.Module, tensors: Mapping[str, Tensor], where: str, hint: str) -> None:
    """Put every tensor into the one of its name. The model may be on the meta device: it then gets memory of its own.

    Buffers that only count batches may be missing. ValueError, one sentence: how many tensors are missing, extra or of another
    shape, the first of them by name, and `hint`.
    """
    own = model.state_dict()
    counters = {name: torch.zeros((), dtype=torch.int64) for name in own if name.endswith(".num_batches_tracked")}
    given = {**counters, **tensors}
    wrong = [line for name in sorted(own.keys() | given.keys()) if (line := _wrong(name, own.get(name), given.get(name)))]
    if wrong:
        named = wrong[:NAMED]
        while len(named) > 1 and sum(map(len, named)) > LONGEST:
            named.pop()
        more = f", and {len(wrong) - len(named)} more" if len(wrong) > len(named) else ""
        raise ValueError(f"{where}: {len(wrong)} of {len(own)} tensors do not fit: {', '.join(named)}{more}; {hint}")
    model.load_state_dict({name: tensor.to(own[name].dtype, copy=True) for name, tensor in given.items()}, assign=True)


def _wrong(name: str, own: Tensor | None, given: Tensor | None) -> str:
    if given is None:
        return f"missing {name}"
    if own is None:
        return f"extra {name}"
    return "" if own.shape == given.shape else f"misshaped {name}: expected {tuple(own.shape)}, got {tuple(given.shape)}"


C = TypeVar("C")
M = TypeVar("M", bound=nn.Module)
MAX_SIZE, MAX_SIZES = 1 << 16, 64
"""the widest layer, and the longest list of them"""


def read_config(path: Path, kind: type[C], form: str, where: str, hint: str) -> C:
    """The dataclass `kind` that a file of the format `form` describes; lists become tuples. ValueError names `where` and what is
    wrong: no JSON, another format, other fields, a field that is no whole number of 1 to MAX_SIZE or a short list of them.
    """
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{where}: expected the config of a trained model, got {reason(error)}; {hint}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != form:
        raise ValueError(f'{where}: expected "format": "{form}"; {hint}')
    names = {field.name for field in dataclasses.fields(kind)}  # type: ignore[arg-type]  # a dataclass
    wrong = next((name for name, value in fields.items() if name not in names or not _is_size(value)), None)
    if wrong is not None:
        raise ValueError(f"{where}: expected {', '.join(sorted(names))} as whole numbers of 1 to {MAX_SIZE}, got {wrong!r}; {hint}")
    plain: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return kind(**plain)


def fill_from_file(model: M, weights: Path, where: str) -> M:
    """Put the weights of a file into a model on the device `meta`. ValueError names `where` and the tensors that do not fit."""
    said = "expected the weights that config.json describes"
    try:
        found = load_file(weights)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{where}: {said}; {reason(error)}") from error
    fill_weights(model, found, where, said)
    return model


def _is_size(value: Any) -> bool:
    values = value if isinstance(value, list) else [value]
    return 0 < len(values) <= MAX_SIZES and all(type(one) is int and 0 < one <= MAX_SIZE for one in values)


DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
SHOWN = 8
"""tensors that are named when they do not fit"""
ERRORS = (OSError, ValueError, RuntimeError, TypeError, KeyError, SafetensorError)
"""what `from_pretrained` raises for files that are missing, cut short or of something else"""


def pretrained(kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """A model of the class `kind` from a local folder, for inference on `device` in `dtype`; the last one is kept in memory.

    ValueError in one sentence: no name, no such folder, another model, a tensor that is missing, left over or misshapen.
    """
    return kept(read_pretrained, kind, name, backend, device, dtype)


def kept(reader: Callable[[Any, Path], Any], kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """As `pretrained`, with a reader of one's own: (class, folder or file) -> model on the CPU."""
    where = local_path(name, backend, kind.__name__)
    return _kept(reader, kind, where, file_stamps(where), device_of(device), dtype_of(dtype))


def local_path(name: str, backend: str, what: str) -> Path:
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


def read_pretrained(kind: Any, where: Path) -> Any:
    """A model of the class `kind` on the CPU, in float32. ValueError names what does not fit."""
    _of_kind(kind, where)
    try:
        model, report = kind.from_pretrained(where, output_loading_info=True, local_files_only=True, use_safetensors=True,
                                             dtype=torch.float32)  # fmt: skip
    except ERRORS as error:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__}; {first_line(error)}") from error
    check_loading(report, kind.__name__, str(where))
    return model


def _of_kind(kind: Any, where: Path) -> None:
    """ValueError when the config is not one of this kind of model; nothing is built from it to find that out."""
    wanted = kind.config_class.model_type
    try:
        config = json.loads((where / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        said = f"model {str(where)!r}: expected config.json of a {kind.__name__} in this folder; {first_line(error)}"
        raise ValueError(said) from error
    got = config.get("model_type") if isinstance(config, dict) else type(config).__name__
    if got != wanted:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__} (model_type {wanted}), got {got}")


def check_loading(report: dict[str, Any], what: str, where: str) -> None:
    """ValueError that names tensors which are missing, misshapen or left over."""
    for key, said in (("missing_keys", "lack"), ("mismatched_keys", "have other shapes in"), ("unexpected_keys", "have besides")):
        names = sorted(str(name[0] if isinstance(name, tuple) else name) for name in report[key])
        if names:
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            raise ValueError(f"model {where!r}: expected the weights of a {what}, these {said} {', '.join(names[:SHOWN])}{more}; "
                             "it is another model, or its files are not whole")


def first_line(error: BaseException) -> str:
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


@contextmanager
def one_thread(device: str) -> Iterator[None]:
    """One intra-op thread of torch on a CPU, afterwards as many as before; nothing on another device.

    Small models gain little from a second thread and lose much where another process has its core; with one thread the result is
    also the same on every number of cores. The number belongs to the calling thread: other threads keep theirs.
    """
    before = torch.get_num_threads()
    if torch.device(device).type != "cpu" or before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
