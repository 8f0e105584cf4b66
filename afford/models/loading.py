"""Load weights into models: every tensor must be present and fit, and nothing is downloaded.

Models are those of `transformers`, or small ones of our own with a config.json. A small model is built on torch's device `meta`,
without memory, until every tensor fits, so that a config with wrong sizes costs nothing.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from afford.common.bounded import reason
from afford.models.weights import file_stamps

CONFIG, WEIGHTS = "config.json", "model.safetensors"
NAMED = 8
"""tensors that an error names; further ones are counted"""
LONGEST = 360
"""characters of their names and shapes in an error"""


def fill_weights(model: nn.Module, tensors: Mapping[str, Tensor], where: str, hint: str, *, mapped: bool = False) -> None:
    """Copy tensors into a model by name. The model may be on the meta device.

    With `mapped` the model takes the tensors themselves, in their own types: memory-mapped ones need no memory.
    Buffers that count batches may be missing. ValueError, one sentence: the number of tensors that are missing, extra or misshaped,
    the names of the first of them, and `hint`.
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
    kept = given if mapped else {name: tensor.to(own[name].dtype, copy=True) for name, tensor in given.items()}
    model.load_state_dict(kept, assign=True)


def _wrong(name: str, own: Tensor | None, given: Tensor | None) -> str:
    if given is None:
        return f"missing {name}"
    if own is None:
        return f"extra {name}"
    return "" if own.shape == given.shape else f"misshaped {name}: expected {tuple(own.shape)}, got {tuple(given.shape)}"


C = TypeVar("C")
M = TypeVar("M", bound=nn.Module)
MAX_SIZE, MAX_SIZES = 1 << 16, 64
"""limits of a size in a config, and of the length of a list of sizes"""


def read_config(path: Path, kind: type[C], form: str, where: str, hint: str) -> C:
    """Read the dataclass `kind` from a JSON file of the format `form`; lists become tuples.

    Fields are whole numbers of 1 to MAX_SIZE, or short lists of them. ValueError names `where` and the fault.
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


class ModelWeights(Protocol):
    """A model with named weights."""

    def state_dict(self) -> Mapping[str, Tensor]:
        """Weights by name."""


def write_model(folder: Path, model: ModelWeights, config: Any, form: str) -> None:
    """Write config.json and model.safetensors, as `read_config` and `fill_from_file` read them."""
    described = {"format": form, **dataclasses.asdict(config)}
    (folder / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def fill_from_file(model: M, weights: Path, where: str) -> M:
    """Load a safetensors file into a model on the device `meta`. ValueError names `where` and the tensors that do not fit."""
    wanted = "expected the weights that config.json describes"
    try:
        found = load_file(weights)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{where}: {wanted}; {reason(error)}") from error
    fill_weights(model, found, where, wanted)
    return model


def _is_size(value: Any) -> bool:
    values = value if isinstance(value, list) else [value]
    return 0 < len(values) <= MAX_SIZES and all(type(one) is int and 0 < one <= MAX_SIZE for one in values)


DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
SHOWN = 8
"""tensors that an error of `check_loading` names"""
ERRORS = (OSError, ValueError, RuntimeError, TypeError, KeyError, SafetensorError)
"""exceptions of `from_pretrained` for files that are missing, damaged or of another kind"""


def load_pretrained(kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """Load a model of the class `kind` from a local folder, for inference on `device` in `dtype`; the last one stays in memory.

    ValueError, one sentence: no name, no such folder, another model, or tensors that are missing, extra or misshaped.
    """
    return load_cached(read_pretrained, kind, name, backend, device, dtype)


def load_cached(reader: Callable[[Any, Path], Any], kind: Any, name: str, backend: str, device: str, dtype: str) -> Any:
    """Load a model as `load_pretrained`, with another reader: (class, folder or file) -> model on the CPU."""
    where = local_path(name, backend, kind.__name__)
    return _load_cached(reader, kind, where, file_stamps(where), device_of(device), dtype_of(dtype))


def local_path(name: str, backend: str, what: str) -> Path:
    """Path of the folder or file of a model. ValueError when it does not exist."""
    if not name:
        raise ValueError(f"backend {backend!r} needs a model: set `model` to a local folder or a hub id of a {what}")
    if not Path(name).exists():
        raise ValueError(f"model {name!r}: expected a {what} in a local folder, got nothing there; check the path, or let "
                         "`pipeline.py run --set STAGE.model=HUB_ID` find a hub id")
    return Path(name)


@lru_cache(maxsize=1)
def _load_cached(reader: Callable[[Any, Path], Any], kind: Any, where: Path, stamped: Any, device: torch.device,
          dtype: torch.dtype) -> Any:  # fmt: skip
    return reader(kind, where).to(device=device, dtype=dtype).eval()


def read_pretrained(kind: Any, where: Path) -> Any:
    """Read a model of the class `kind` on the CPU, in float32. ValueError names what does not fit."""
    _of_kind(kind, where)
    try:
        model, report = kind.from_pretrained(where, output_loading_info=True, local_files_only=True, use_safetensors=True,
                                             dtype=torch.float32)  # fmt: skip
    except ERRORS as error:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__}; {first_line(error)}") from error
    check_loading(report, kind.__name__, str(where))
    return model


def _of_kind(kind: Any, where: Path) -> None:
    """Raise ValueError when the config is of another kind of model, before anything is built from it."""
    wanted = kind.config_class.model_type
    try:
        config = json.loads((where / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        wanted = f"model {str(where)!r}: expected config.json of a {kind.__name__} in this folder; {first_line(error)}"
        raise ValueError(wanted) from error
    got = config.get("model_type") if isinstance(config, dict) else type(config).__name__
    if got != wanted:
        raise ValueError(f"model {str(where)!r}: expected the weights of a {kind.__name__} (model_type {wanted}), got {got}")


def check_loading(report: dict[str, Any], what: str, where: str) -> None:
    """Raise ValueError that names the tensors which a loading report lists as missing, misshaped or extra."""
    for key, verb in (("missing_keys", "lack"), ("mismatched_keys", "have other shapes in"), ("unexpected_keys", "have besides")):
        names = sorted(str(name[0] if isinstance(name, tuple) else name) for name in report[key])
        if names:
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            raise ValueError(f"model {where!r}: expected the weights of a {what}, these {verb} {', '.join(names[:SHOWN])}{more}; "
                             "it is another model, or its files are not whole")


def first_line(error: BaseException) -> str:
    """First line of an error message that is not empty."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)


def device_of(name: str) -> torch.device:
    """Device of a name: cpu, cuda or cuda:N. ValueError for a device that this machine lacks."""
    if name.partition(":")[0] == "cuda" and not torch.cuda.is_available():
        raise ValueError(f"device {name!r}: this machine has no CUDA GPU; set device to cpu")
    try:
        return torch.device(name)
    except RuntimeError as error:
        raise ValueError(f"device {name!r}: expected cpu, cuda or cuda:N") from error


def dtype_of(name: str) -> torch.dtype:
    """Type of a name in DTYPES. ValueError for another name."""
    if name not in DTYPES:
        raise ValueError(f"dtype {name!r}: expected one of {', '.join(DTYPES)}")
    return DTYPES[name]


@contextmanager
def one_thread(device: str) -> Iterator[None]:
    """Context with one intra-op thread of torch on a CPU; no effect for other devices.

    Small models gain little from a second thread, and lose much when another process uses its core. With one thread the result does
    not depend on the number of cores. The setting is that of the calling thread; other threads keep theirs.
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
