"""config.json and model.safetensors of a small trained model -> its config, its weights.

The model is made without memory (torch's device `meta`) until every tensor of the file fits, so that a config that states sizes
beyond the file's costs nothing.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, TypeVar

from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import nn

from afford.common.bounded import reason
from afford.models.fitting import fit

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


def fill(model: M, weights: Path, where: str) -> M:
    """Put the weights of a file into a model on the device `meta`. ValueError names `where` and the tensors that do not fit."""
    said = "expected the weights that config.json describes"
    try:
        found = load_file(weights)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{where}: {said}; {reason(error)}") from error
    fit(model, found, where, said)
    return model


def _is_size(value: Any) -> bool:
    values = value if isinstance(value, list) else [value]
    return 0 < len(values) <= MAX_SIZES and all(type(one) is int and 0 < one <= MAX_SIZE for one in values)
