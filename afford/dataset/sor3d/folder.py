"""A root of sequences, or of pictures, -> one file tree each, from names and digests alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from afford.common.errors import SourceError
from afford.common.folders import Entry, entries
from afford.common.text import read_utf8
from afford.dataset.sor3d.names import SPLITS, VIEWS
from schemas.files import FileRef, FileTree

Digest = Callable[[Path], str]


def discover(root: Path, digest: Digest) -> tuple[FileTree, ...]:
    """One tree per sequence of a SOR3D-AFF root, train first, names relative to the root. SourceError when there is none, a file
    leaves the root, or two sequences have one name.
    """
    if not root.is_dir():
        raise SourceError(str(root), "a folder with train/ and val/", "a file" if root.exists() else "nothing", "give the root")
    found: dict[str, list[Entry]] = {}
    for entry in entries(root):
        words = entry.name.split("/")
        if len(words) >= 3 and words[0] in SPLITS:
            found.setdefault("/".join(words[:2]), []).append(entry)
    if not found:
        raise SourceError(str(root), "train/<Subject>_<action>_<object>/rgb/ or the same in val/", "no such folder",
                          "name the folders as docs/rgbd/interaction-data.md says")  # fmt: skip
    names = Counter(key.partition("/")[2] for key in found)
    twice = next((name for name, count in names.items() if count > 1), None)
    if twice is not None:
        raise SourceError(str(root), "sequences of one name only", f"{twice!r} in train and val", "rename one")
    return tuple(tree(key.partition("/")[2], kept, digest) for key, kept in sorted(found.items()))


def tree(name: str, kept: Iterable[Entry], digest: Digest) -> FileTree:
    """Entries as a tree; SourceError for one that leaves the root."""
    refs = []
    for entry in kept:
        if entry.leaves:
            raise SourceError(entry.name, "a file below the root", "a link that leaves it", "copy the file there")
        refs.append(FileRef(entry.name, digest(entry.path), entry.path.stat().st_size, entry.path))
    return FileTree(name, tuple(sorted(refs, key=lambda ref: ref.name)))


def views(root: Path) -> dict[str, int]:
    """Which of three cameras saw each person, where the root says so; SourceError for a line that is not `SubjectN<tab>1..3`."""
    path = root / VIEWS
    if not path.is_file():
        return {}
    out = {}
    for number, line in enumerate(read_utf8(path, VIEWS).splitlines(), 1):
        subject, _, view = line.partition("\t")
        if line and view.strip() not in ("1", "2", "3"):
            raise SourceError(f"{VIEWS}, line {number}", "SubjectN, a tab, and 1, 2 or 3", repr(line), "correct the line")
        if line:
            out[subject] = int(view)
    return out
