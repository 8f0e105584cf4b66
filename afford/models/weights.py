"""Where the weights of a stage lie: files among its inputs, or the folder that its parameters name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from schemas.files import FileTree

P = TypeVar("P")


def placed(params: P, weights: FileTree | None) -> P:
    """Params of a stage whose `model` says where the files of `weights` lie on this machine; as they are when there are none.

    The place is in no key: the content of the files is. ValueError when the files do not lie in one folder.
    """
    if weights is None:
        return params
    return replace(params, model=str(root(weights)))  # type: ignore[type-var]  # the Params of a stage are a dataclass


def root(weights: FileTree) -> Path:
    """The folder that the names of the files are relative to; the file itself when there is only one."""
    if len(weights.files) == 1:
        return weights.files[0].path
    found = {Path(str(file.path).removesuffix(file.name)) for file in weights.files if str(file.path).endswith(file.name)}
    if len(found) != 1:
        raise ValueError(f"weights {weights.name!r}: expected files in one folder, got {len(found)}; name the folder again")
    return found.pop()


def stamp(place: Path) -> Any:
    """What changes when a file of the weights does: name, size and time of each, so that no stale model is kept in memory."""
    files = [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.is_file())
    return tuple((str(path), path.stat().st_size, path.stat().st_mtime_ns, path.stat().st_ino) for path in files)
