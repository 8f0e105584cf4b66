"""Discover the objects in a folder of meshes, or a single mesh: one file tree for each, with exactly the files it needs.

Discovery runs before any computation. An object is a URDF (named by its stem), a mesh file in the folder itself (by its stem), or a
subfolder with one mesh (by the name of the folder). Meshes that a URDF refers to are not objects of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from afford.common.errors import SourceError
from afford.common.folders import Entry, entries, refuse_link
from afford.surface.meshes.read import collision_meshes, is_mesh, referenced_files
from afford.surface.meshes.surface import LABELS, URDF
from schemas.files import FileRef, FileTree

Digest = Callable[[Path], str]


@dataclass(frozen=True)
class RejectedObject:
    """Object that must not or cannot be read; other objects are not affected."""

    name: str
    reason: str
    """one sentence: file, expected, found, fix"""


@dataclass(frozen=True)
class MeshFolder:
    """Objects of a folder, by name."""

    name: str
    """name of the folder, or of the mesh without suffix"""
    objects: tuple[FileTree, ...]
    refused: tuple[RejectedObject, ...]


def discover(root: Path, digest: Digest) -> MeshFolder:
    """List the objects below `root`, which may also be one mesh file.

    SourceError for another path, or a folder without meshes.
    """
    if root.is_file() and is_mesh(root.name):
        return _single(root, digest)
    if not root.is_dir():
        raise SourceError(str(root), "a folder of meshes, or a mesh", "a file" if root.exists() else "nothing", "give the folder")
    found = {entry.name: entry for entry in entries(root)}
    trees: list[FileTree] = []
    refused: list[RejectedObject] = []
    for name, mains in _objects(found).items():
        try:
            trees.append(_tree(name, mains, found, digest))
        except (SourceError, OSError) as error:
            refused.append(RejectedObject(name, str(error)))
    if not trees and not refused:
        raise SourceError(str(root), "a mesh (OBJ, PLY, STL, GLB, glTF) or a URDF", "no such file", "put one there")
    return MeshFolder(root.resolve().name, tuple(trees), tuple(refused))


def _single(root: Path, digest: Digest) -> MeshFolder:
    """Discover one mesh file, with what it refers to in its folder. SourceError where it cannot be read."""
    found = {entry.name: entry for entry in entries(root.parent)}
    return MeshFolder(root.stem, (_tree(root.stem, [found[root.name]], found, digest),), ())


def _objects(found: dict[str, Entry]) -> dict[str, list[Entry]]:
    """Group candidate main files by object name; a valid object has exactly one."""
    claimed: set[str] = set()
    out: dict[str, list[Entry]] = {}
    for entry in found.values():
        if entry.suffix == URDF:
            out.setdefault(entry.stem, []).append(entry)
            claimed |= _claimed(entry)
    for entry in found.values():
        if is_mesh(entry.name) and entry.name not in claimed:
            out.setdefault(entry.stem if entry.top else entry.name.split("/")[0], []).append(entry)
    return dict(sorted(out.items()))


def _claimed(entry: Entry) -> set[str]:
    """Return the meshes that a URDF refers to; an unreadable URDF is reported later."""
    try:
        return set() if entry.leaves else {*referenced_files(entry.name, entry.path), *collision_meshes(entry.name, entry.path)}
    except SourceError:
        return set()


def _tree(name: str, mains: list[Entry], found: dict[str, Entry], digest: Digest) -> FileTree:
    if len(mains) > 1:
        raise SourceError(name, "one mesh or URDF of that name, or one in the folder", ", ".join(entry.name for entry in mains),
                          "keep one, rename the others, or join them in a URDF")
    members, waiting = {}, [mains[0]]
    while waiting:
        entry = waiting.pop()
        if entry.name in members:
            continue
        refuse_link(entry)
        members[entry.name] = entry
        wanted = [*referenced_files(entry.name, entry.path), entry.name + LABELS]
        waiting.extend(found[other] for other in wanted if other in found)
    return FileTree(name, tuple(_refs(members.values(), digest)))


def _refs(members: Iterable[Entry], digest: Digest) -> list[FileRef]:
    ordered = sorted(members, key=lambda entry: entry.name)
    return [FileRef(e.name, digest(e.path), e.path.stat().st_size, e.path) for e in ordered]
