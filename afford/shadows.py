"""Detect modules of the user that shadow modules of afford on Python's path, before an import fails with a confusing error."""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib.machinery import PathFinder

DYNAMIC = ()  # modules are looked for, and none is loaded


class ShadowedError(ImportError):
    """A module shadows one of afford; the message names its place and the remedy."""


def refuse(names: Iterable[str]) -> None:
    """Raise ShadowedError if Python would import one of these top-level modules from another folder than that of afford."""
    root = _folder("afford")
    for name in names:
        found = _folder(name)
        if root and found and found != root:
            raise ShadowedError(f"{os.path.join(found, name)} hides the `{name}` of afford, which lies in {root}; start Python in "
                                "another folder, or rename yours")  # fmt: skip


def _folder(name: str) -> str:
    """Folder on the path that contains a top-level module; '' if there is no such module, or only a folder without code."""
    spec = PathFinder.find_spec(name)
    if spec is None or not spec.origin:
        return ""
    file = os.path.realpath(spec.origin)
    return os.path.dirname(os.path.dirname(file) if spec.submodule_search_locations else file)
