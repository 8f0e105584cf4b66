"""Weights of pretrained models: parameters of their backends, local folders, and downloads from a hub.

A hub id is OWNER/NAME for the newest files, or OWNER/NAME@REVISION for those of a branch, a tag or a commit.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from schemas.files import FileRef, FileTree


@dataclass(frozen=True)
class Pretrained:
    """Parameters of a backend with a pretrained model."""

    model: str = ""
    """local folder or file, or hub id, of the weights"""
    device: str = "cpu"
    """cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """float32, bfloat16 or float16"""


READ = (".json", ".safetensors", ".txt", ".model", ".jinja")
"""suffixes of the files of a published model that are downloaded"""
ALSO = (".pt", ".pth", ".ckpt", ".bin")
"""further suffixes that are read in a local folder"""
LABEL = "weights"
HUB_ID = re.compile(r"(?P<id>[A-Za-z0-9][\w.-]*(/[A-Za-z0-9][\w.-]*)?)(@(?P<revision>[A-Za-z0-9][\w./-]*))?")


def weight_files(name: str, digest: Callable[[Path], str]) -> FileTree:
    """List the files of a model with their content digests, which do not depend on the place of the files.

    ValueError for a folder without files of a model.
    """
    place = find_model(name)
    if place.is_file():
        return FileTree(LABEL, (_ref(place, place.name, digest),))
    found = sorted(path for path in place.rglob("*") if path.suffix in READ + ALSO and path.is_file())
    if not found:
        raise ValueError(f"model {name!r}: the folder has no files of a model ({', '.join(READ + ALSO)}); "
                         "name the folder that holds config.json and the weights")
    return FileTree(LABEL, tuple(_ref(path, path.relative_to(place).as_posix(), digest) for path in found))


def find_model(name: str) -> Path:
    """Local path of a model; a hub id is downloaded. ValueError says what was tried."""
    place = Path(name).expanduser()
    if place.exists():
        return place.absolute()
    if not HUB_ID.fullmatch(name):
        raise ValueError(f"model {name!r}: expected a local folder or file, or a hub id (OWNER/NAME or OWNER/NAME@REVISION), got "
                         "nothing there; check the path")
    from huggingface_hub import snapshot_download

    repository, revision = split_revision(name)
    try:
        return Path(snapshot_download(repository, revision=revision, allow_patterns=[f"*{ending}" for ending in READ]))
    except (OSError, ValueError) as error:
        chosen = f"{repository} --revision {revision}" if revision else repository
        raise ValueError(f"model {name!r}: expected a local folder, or a hub id that is in the cache of downloads or can be "
                         f"reached, got neither ({type(error).__name__}); download it where there is a network "
                         f"(hf download {chosen} --local-dir DIR) and name that folder") from error


def split_revision(name: str) -> tuple[str, str | None]:
    """Split a hub id into repository and revision; None for the newest revision."""
    repository, _, revision = name.partition("@")
    return repository, revision or None


def _ref(path: Path, name: str, digest: Callable[[Path], str]) -> FileRef:
    return FileRef(name, digest(path), path.stat().st_size, path)


P = TypeVar("P")


def with_local_weights(params: P, weights: FileTree | None, named: str = "model") -> P:
    """Set the field `named` of the Params of a stage to the local path of `weights`; no change without weights.

    The path is not part of a task's key, but the content of the files is.
    """
    if weights is None:
        return params
    return replace(params, **{named: str(weights_root(weights))})  # type: ignore[type-var]  # the Params of a stage are a dataclass


def weights_root(weights: FileTree) -> Path:
    """Folder of the files of weights, or the file itself when there is only one.

    Files that have other names on disk, as in the cache of a hub, get a folder of links, which is removed with the process.
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


def file_stamps(place: Path) -> Any:
    """Name, size, time and inode of each file of the weights, as the key of models that are kept in memory."""
    files = [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.is_file())
    return tuple((str(path), path.stat().st_size, path.stat().st_mtime_ns, path.stat().st_ino) for path in files)
