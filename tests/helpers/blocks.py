"""Parameters of a stage with changes, in the block of its backend or beside it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

P = TypeVar("P")


def changed(params: P, **changes: Any) -> P:
    """`params` with these fields changed: of its selected backend where that has them, of the stage otherwise."""
    backend = getattr(params, "backend", "")
    block = getattr(params, backend, None)
    own = {field.name for field in fields(block)} if block is not None else set()
    inside = {name: value for name, value in changes.items() if name in own}
    outside = {name: value for name, value in changes.items() if name not in own}
    return replace(params, **outside, **({backend: replace(block, **inside)} if inside else {}))
