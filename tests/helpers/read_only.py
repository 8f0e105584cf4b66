"""Values as the store gives them: their arrays cannot be written to."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def read_only(value: T) -> T:
    """The same value, its arrays closed, however deep they lie."""
    for inner in _inside(value):
        if isinstance(inner, np.ndarray):
            inner.flags.writeable = False
        else:
            read_only(inner)
    return value


def _inside(value: Any) -> list[Any]:
    if isinstance(value, tuple):
        return list(value)
    return [getattr(value, field.name) for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else []
