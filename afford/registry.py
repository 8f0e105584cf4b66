"""Backends by name: a literal dict ``name -> "module:attribute"``, resolved at the moment of use so that leafs load late."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

DYNAMIC = ()  # nothing is loaded here that the literal registry of the caller does not name


def load(registry: Mapping[str, str], name: str) -> Any:
    """The object that `registry` names; KeyError lists the valid names."""
    if name not in registry:
        raise KeyError(f"unknown backend {name!r}; choose one of {', '.join(sorted(registry))}")
    module, attribute = registry[name].split(":")
    return getattr(importlib.import_module(module), attribute)
