"""What lies in a source folder, by name alone: links that leave the folder are listed, never followed.

A folder of many images is listed as one, and not looked into: 11.5 million frames are 700 entries.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath

from afford.common.errors import SourceError
from schemas.files import FileTree

VIDEO_SUFFIXES = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg")
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
PACK_SUFFIXES = (".tar", ".zip")
"""frames in one file"""
DENSE = "Interpolations-DenseAnnotations/"
FEW = 500
"""images of a folder that are files of their own; a folder of more is taken as one, as a tar is"""


@dataclass(frozen=True)
class Entry:
    """One file below the root, or what must not be opened: a link that leaves the root (to a file or to a folder), or no file."""

    name: str
    """root-relative, with forward slashes"""
    path: Path
    leaves: bool
    """it must not be opened"""
    many: bool = False
    """a folder of more than `FEW` images"""
    odd: str = ""
    """what it is where it is neither file nor folder: reading it might never end"""

    @property
    def stem(self) -> str:
        return PurePosixPath(self.name).stem

    @property
    def is_pack(self) -> bool:
        """Frames that lie together: a tar, a zip or a folder of many."""
        return self.many or is_pack(self.name)

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
    does not decode them again.
    """
    suffixes = VIDEO_SUFFIXES + IMAGE_SUFFIXES
    return FileTree(files.name, tuple(
        f for f in files.files if PurePosixPath(f.name).suffix.lower() in suffixes or is_pack(f.name)))


def is_pack(name: str) -> bool:
    """Whether a file of a tree holds many frames, by its name: of a folder, which alone has no suffix, a tar or a zip."""
    suffix = PurePosixPath(name).suffix.lower()
    return (suffix == "" or suffix in PACK_SUFFIXES) and not name.startswith(DENSE)


def entries(root: Path) -> tuple[Entry, ...]:
    """Everything below `root` but hidden files, sorted by name. OSError when the folder cannot be listed."""
    real = root.resolve()
    return tuple(sorted(_walk(real, real, ""), key=lambda entry: entry.name))


def _walk(real: Path, folder: Path, prefix: str) -> Iterator[Entry]:
    with os.scandir(folder) as found:
        some = list(islice(found, FEW + 1))
        if prefix and len(some) > FEW and all(_is_image(item.name) and item.is_file() for item in some):
            yield Entry(prefix.removesuffix("/"), folder, leaves=False, many=True)
            return
        items = [item for item in (*some, *found) if not item.name.startswith(".")]
    for item in items:
        path = Path(item.path)
        target = Path(os.path.realpath(path)) if item.is_symlink() else path
        if target != path and not target.is_relative_to(real):
            yield Entry(prefix + item.name, path, leaves=True)
        elif not os.path.isdir(path):
            odd = "" if item.is_file(follow_symlinks=False) else _odd(path)
            yield Entry(prefix + item.name, path, leaves=bool(odd), odd=odd)
        elif target == path or not path.is_relative_to(target):
            yield from _walk(real, path, f"{prefix}{item.name}/")


def _odd(path: Path) -> str:
    """What a path leads to that is no regular file; '' for a file, and for a link to nothing, which cannot be opened anyway."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return ""
    if stat.S_ISREG(mode):
        return ""
    return "a named pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"


def _is_image(name: str) -> bool:
    return PurePosixPath(name).suffix.lower() in IMAGE_SUFFIXES


def refuse_link(entry: Entry) -> None:
    """SourceError for what lies outside the source folder, or is no file."""
    if entry.odd:
        raise SourceError(entry.name, "a file", entry.odd, "put the file itself there, or remove it from the folder")
    if entry.leaves:
        raise SourceError(entry.name, "a file inside the source folder", f"a link to {entry.path.resolve()}",
                          "copy the file into the folder, or use the folder it lies in as the source")
