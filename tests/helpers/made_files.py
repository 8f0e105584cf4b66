"""FileTree artifacts of a few small files, and what a folder shows of them."""

from __future__ import annotations

from pathlib import Path

from afford.common.files import tree
from runner import Runner


def artifact(runner: Runner, place: Path, **texts: str) -> str:
    """The digest of a FileTree of these files, which are written to `place`."""
    place.mkdir(parents=True)
    for name, text in texts.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return runner.store.put_leaf(tree("set", place))


def content(folder: Path) -> dict[str, bytes]:
    """Name -> bytes of every file below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
