"""Files that enter the pipeline or leave a stage: named, content-digested, read-only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from schemas.spec import Schema, value


@dataclass(frozen=True)
class FileRef(Schema):
    """One file, or one folder of frames, identified by name and digest. Its path is not part of its identity."""

    name: str = value("path relative to the source root, with forward slashes")
    digest: str = value("blake3 of the bytes, hex; of a folder, of its names and their bytes")
    size: int = value("length; 0 of a folder", unit="bytes")
    path: Path = value("where it can be read on this machine; not part of the identity")


@dataclass(frozen=True)
class FileTree(Schema):
    """Folder of files, sorted by name. `name` labels the shard: a video, a scene, an exported data set."""

    name: str = value("label, unique among its siblings")
    files: tuple[FileRef, ...] = value("sorted by name")

    def find(self, name: str) -> FileRef | None:
        """Return the file with exactly this name, or None."""
        return next((file for file in self.files if file.name == name), None)

    def under(self, folder: str) -> tuple[FileRef, ...]:
        """Return all files below `folder` (no trailing slash), in order."""
        return tuple(file for file in self.files if file.name.startswith(folder + "/"))
