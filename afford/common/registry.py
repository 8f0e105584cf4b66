"""Backends by name: a literal dict ``name -> "module:attribute"``, resolved at the moment of use so that leafs load late; and
packages that only an extra installs.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, TypeVar

DYNAMIC = ()  # no module of ours is loaded here that the literal registry of the caller does not name

Own = TypeVar("Own", contravariant=True)
"""the parameters of one backend in the Protocol of its question; None for a backend that has none"""


def load(registry: Mapping[str, str], name: str) -> Any:
    """The object that `registry` names; KeyError lists the valid names."""
    if name not in registry:
        raise KeyError(f"unknown backend {name!r}; choose one of {', '.join(sorted(registry))}")
    module, attribute = registry[name].split(":")
    return getattr(importlib.import_module(module), attribute)


def block(params: object, name: str) -> Any:
    """The parameters of the entry `name` alone: the field of Params that is named so; None for an entry without any."""
    return getattr(params, name.replace("-", "_"), None)


def extra(package: str, name: str) -> Any:
    """A package of the extra `name` of pyproject.toml; ValueError when it is not installed. No stage may compute with it: its
    version is in no key.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise ValueError(f"{package}: expected this package of the extra `{name}`, got none; "
                         f"make setup EXTRA={name}") from error
