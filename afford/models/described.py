"""config.json of a small trained model -> its config."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, TypeVar

from afford.bounded import reason

C = TypeVar("C")


def read_config(path: Path, kind: type[C], form: str, where: str, hint: str) -> C:
    """The dataclass `kind` that a file of the format `form` describes; lists become tuples. ValueError names `where` and what is
    wrong: no JSON, another format, other fields, a field that is no whole number above 0 or a list of them."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{where}: expected the config of a trained model, got {reason(error)}; {hint}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != form:
        raise ValueError(f'{where}: expected "format": "{form}"; {hint}')
    names = {field.name for field in dataclasses.fields(kind)}  # type: ignore[arg-type]  # a dataclass
    wrong = next((name for name, value in fields.items() if name not in names or not _is_size(value)), None)
    if wrong is not None:
        raise ValueError(f"{where}: expected {', '.join(sorted(names))} as whole numbers above 0, got {wrong!r}; {hint}")
    plain: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return kind(**plain)


def _is_size(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(type(one) is int and one > 0 for one in value)
    return type(value) is int and value > 0
