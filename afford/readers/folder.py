"""What lies in a source folder, by name alone: links that leave the folder are listed, never followed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from schemas.files import FileTree

VIDEO_SUFFIXES = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg")
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Entry:
    """One file below the root, or a link that leaves the root (to a file or to a folder)."""

    name: str
    """root-relative, with forward slashes"""
    path: Path
    leaves: bool

    @property
    def stem(self) -> str:
        return PurePosixPath(self.name).stem

    @property
    def suffix(self) -> str:
        return PurePosixPath(self.name).suffix.lower()

    @property
    def folder(self) -> str:
        """Name of the folder that holds the file; '' at the top."""
        return PurePosixPath(self.name).parent.name

    @property
    def top(self) -> bool:
        return "/" not in self.name


def media_of(files: FileTree) -> FileTree:
    """The files of a video that hold its pictures. What decodes frames is given no others, so that an edited table or outline
    does not decode them again."""
    suffixes = VIDEO_SUFFIXES + IMAGE_SUFFIXES
    return FileTree(files.name, tuple(f for f in files.files if PurePosixPath(f.name).suffix.lower() in suffixes))


def entries(root: Path) -> tuple[Entry, ...]:
    """Everything below `root` but hidden files, sorted by name. OSError when the folder cannot be listed."""
    real = root.resolve()
    return tuple(sorted(_walk(real, real, ""), key=lambda entry: entry.name))


def _walk(real: Path, folder: Path, prefix: str) -> Iterator[Entry]:
    with os.scandir(folder) as found:
        items = [item for item in found if not item.name.startswith(".")]
    for item in items:
        path = Path(item.path)
        target = Path(os.path.realpath(path)) if item.is_symlink() else path
        if target != path and not target.is_relative_to(real):
            yield Entry(prefix + item.name, path, leaves=True)
        elif not os.path.isdir(path):
            yield Entry(prefix + item.name, path, leaves=False)
        elif target == path or not path.is_relative_to(target):
            yield from _walk(real, path, f"{prefix}{item.name}/")
