"""The files behind the name of a model: a local folder or file, or a hub id, which is downloaded once.

A hub id is OWNER/NAME, the newest files of it, or OWNER/NAME@REVISION: those of a branch, a tag or a commit.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from schemas.files import FileRef, FileTree

READ = (".json", ".safetensors", ".txt", ".model", ".jinja")
"""endings of what is read of a published model"""
ALSO = (".pt", ".pth", ".ckpt", ".bin")
"""and of a local folder"""
LABEL = "weights"
HUB_ID = re.compile(r"(?P<id>[A-Za-z0-9][\w.-]*(/[A-Za-z0-9][\w.-]*)?)(@(?P<revision>[A-Za-z0-9][\w./-]*))?")


def files(name: str, digest: Callable[[Path], str]) -> FileTree:
    """The files of a model with their content digests, wherever they lie and whatever the folder is called. ValueError when
    there are none.
    """
    place = find(name)
    if place.is_file():
        return FileTree(LABEL, (_ref(place, place.name, digest),))
    found = sorted(path for path in place.rglob("*") if path.suffix in READ + ALSO and path.is_file())
    if not found:
        raise ValueError(f"model {name!r}: expected files of a model ({', '.join(READ + ALSO)}) in the folder, got none; "
                         "name the folder that holds config.json and the weights")
    return FileTree(LABEL, tuple(_ref(path, path.relative_to(place).as_posix(), digest) for path in found))


def find(name: str) -> Path:
    """Where a model lies. ValueError says what was tried."""
    place = Path(name).expanduser()
    if place.exists():
        return place.absolute()
    if not HUB_ID.fullmatch(name):
        raise ValueError(f"model {name!r}: expected a local folder or file, or a hub id (OWNER/NAME or OWNER/NAME@REVISION), got "
                         "nothing there; check the path")
    from huggingface_hub import snapshot_download

    repository, revision = pinned(name)
    try:
        return Path(snapshot_download(repository, revision=revision, allow_patterns=[f"*{ending}" for ending in READ]))
    except (OSError, ValueError) as error:
        chosen = f"{repository} --revision {revision}" if revision else repository
        raise ValueError(f"model {name!r}: expected a local folder, or a hub id that is in the cache of downloads or can be "
                         f"reached, got neither ({type(error).__name__}); download it where there is a network "
                         f"(hf download {chosen} --local-dir DIR) and name that folder") from error


def pinned(name: str) -> tuple[str, str | None]:
    """The repository of a hub id, and the revision after its `@`, None for the newest."""
    repository, _, revision = name.partition("@")
    return repository, revision or None


def _ref(path: Path, name: str, digest: Callable[[Path], str]) -> FileRef:
    return FileRef(name, digest(path), path.stat().st_size, path)
