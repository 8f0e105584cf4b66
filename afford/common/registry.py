"""Backend registries: a literal dict ``name -> "module:attribute"``, resolved on use, and optional extras.

Resolution on use keeps heavy modules out of the import of a stage.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, TypeVar

DYNAMIC = ()  # only modules that a literal registry of the caller lists are loaded here

Own = TypeVar("Own", contravariant=True)
"""type of the parameters of a backend in the Protocol of its interface; None for a backend without parameters"""


def load(registry: Mapping[str, str], name: str) -> Any:
    """Import the object that `registry` lists under `name`; KeyError lists the valid names."""
    if name not in registry:
        raise KeyError(f"unknown backend {name!r}; choose one of {', '.join(sorted(registry))}")
    module, attribute = registry[name].split(":")
    return getattr(importlib.import_module(module), attribute)


def block(params: object, name: str) -> Any:
    """Return the parameters of the backend `name`: the field of Params with that name, None without one."""
    return getattr(params, name.replace("-", "_"), None)


def extra(package: str, name: str) -> Any:
    """Import a package of the extra `name` of pyproject.toml; ValueError when it is not installed.

    A stage that computes with such a package declares it among the libraries of that backend, so that its version is in the key.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise ValueError(f"{package} is not installed; run `make setup EXTRA={name}`") from error
