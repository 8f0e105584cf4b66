"""Folders of a user's that hide ours, because Python's path has them first: found before an import fails with a riddle."""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib.machinery import PathFinder

DYNAMIC = ()  # modules are looked for, and none is loaded


class ShadowedError(ImportError):
    """Another module has the name of ours; the message says where it lies and what to do."""


def refuse(names: Iterable[str]) -> None:
    """ShadowedError when Python would take one of these top-level modules from elsewhere than from beside afford."""
    root = _folder("afford")
    for name in names:
        found = _folder(name)
        if root and found and found != root:
            raise ShadowedError(f"{os.path.join(found, name)} hides the `{name}` of afford, which lies in {root}; start Python in "
                                "another folder, or rename yours")  # fmt: skip


def _folder(name: str) -> str:
    """The folder in which the path has a top-level module; '' where it has none, or a folder without code."""
    spec = PathFinder.find_spec(name)
    if spec is None or not spec.origin:
        return ""
    file = os.path.realpath(spec.origin)
    return os.path.dirname(os.path.dirname(file) if spec.submodule_search_locations else file)
