"""Where the weights of a stage lie: files among its inputs, or the folder that its parameters name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from schemas.files import FileTree

P = TypeVar("P")


def placed(params: P, weights: FileTree | None, named: str = "model") -> P:
    """Params of a stage whose `named` says where the files of `weights` lie on this machine; as they are when there are none.

    The place is in no key: the content of the files is.
    """
    if weights is None:
        return params
    return replace(params, **{named: str(root(weights))})  # type: ignore[type-var]  # the Params of a stage are a dataclass


def root(weights: FileTree) -> Path:
    """The folder in which the files have their names, or the file itself when there is only one.

    Where they lie under other names, as in the cache of a hub, it is a folder of links that lives as long as the process.
    """
    found = {Path(str(file.path).removesuffix(file.name)) for file in weights.files if str(file.path).endswith(f"/{file.name}")}
    named = len(found) == 1 and all(found == {Path(str(file.path).removesuffix(file.name))} for file in weights.files)
    folder = found.pop() if named else Path(_links(tuple((file.name, file.path) for file in weights.files)).name)
    return folder / weights.files[0].name if len(weights.files) == 1 else folder


@cache
def _links(files: tuple[tuple[str, Path], ...]) -> TemporaryDirectory[str]:
    folder = TemporaryDirectory(prefix="afford-weights-")
    for name, path in files:
        link = Path(folder.name) / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(path)
    return folder


def stamp(place: Path) -> Any:
    """What changes when a file of the weights does: name, size and time of each, so that no stale model is kept in memory."""
    files = [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.is_file())
    return tuple((str(path), path.stat().st_size, path.stat().st_mtime_ns, path.stat().st_ino) for path in files)
