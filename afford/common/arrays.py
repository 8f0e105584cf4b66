"""Functions for formulas that are written once for numpy's arrays and torch's tensors.

Such a formula uses `namespace(x)` for functions that both libraries have under one name (where, einsum, stack, concatenate,
linalg.norm), and `axis` for dimensions, which torch accepts as well. What differs between them is here. Annotations name numpy's
array; a tensor has the same shape, and its numbers have 64 bits as well.

torch is not imported: without a tensor it is not needed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

DYNAMIC = ()  # no module is imported here: `namespace` finds the one that an array or tensor comes from

Record = TypeVar("Record")
"""dataclass with arrays among its fields"""


def namespace(x: Any) -> Any:
    """Return the module, numpy or torch, whose functions compute on `x`."""
    return np if isinstance(x, np.ndarray | np.generic) else sys.modules[type(x).__module__.partition(".")[0]]


def to_numpy(x: Any) -> Any:
    """Return an array as it is, and a tensor as an array, copied to the CPU where it is on another device."""
    return x.cpu().numpy() if hasattr(x, "cpu") else x


def like(x: Any, other: Any) -> Any:
    """Return an array or tensor `x` in the library, and on the device, of `other`; an array becomes a tensor by a copy."""
    if isinstance(other, np.ndarray):
        return to_numpy(x)
    return namespace(other).tensor(x, device=other.device) if isinstance(x, np.ndarray) else x.to(other.device)


def number(x: Any) -> Any:
    """Convert truth values or integers to float64."""
    return x.astype(np.float64) if isinstance(x, np.ndarray) else x.double()


def single(x: Any) -> Any:
    """Convert numbers to float32."""
    return x.astype(np.float32) if isinstance(x, np.ndarray) else x.float()


def copied(x: Any) -> Any:
    """Copy an array or tensor."""
    return x.copy() if isinstance(x, np.ndarray) else x.clone()


def taken(x: Any, chosen: Any, axis: int) -> Any:
    """Take values of `x` by their numbers along an axis (numpy's take_along_axis)."""
    return np.take_along_axis(x, chosen, axis) if isinstance(x, np.ndarray) else namespace(x).take_along_dim(x, chosen, axis)


def mapped(record: Record, convert: Callable[[Any], Any]) -> Record:
    """Convert the arrays and tensors among the fields of a dataclass; other fields stay."""
    found = {f.name: getattr(record, f.name) for f in fields(record)}  # type: ignore[arg-type]  # a dataclass
    changed = {name: convert(value) for name, value in found.items() if hasattr(value, "ndim")}
    return replace(record, **changed)  # type: ignore[type-var]  # a dataclass
