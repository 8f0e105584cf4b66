"""ActAffordance's folders by name alone: which files belong to which case.

[data/]{masks,cropped}/<video>/<frame>/{inpainting.png, annotation.json, aff_left.png?, ...}     truth
[masks|cropped/][<threshold>/]<video>/<frame>/aff_{left,right}.png                               predictions of any method
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from afford.common.errors import SourceError
from afford.common.folders import entries
from schemas.files import FileRef, FileTree

PROTOCOLS = ("cropped", "masks")
IMAGE, ANNOTATION, MODES = "inpainting.png", "annotation.json", "modes.json"
THRESHOLD = re.compile(r"\d*\.?\d+$")
"""how the released code ends the name of a threshold's folder"""
DEPTH = 3
"""names of a case from the right: video, frame, file"""


class CaseFiles(NamedTuple):
    """The files of one case by their own names."""

    protocol: str
    video: str
    frame: str
    files: dict[str, FileRef]

    @property
    def where(self) -> str:
        return f"{self.protocol}/{self.video}/{self.frame}"


def tree(root: Path, digest: Callable[[Path], str]) -> FileTree:
    """The files below `root` with their content digests. SourceError for a missing folder or a link that leaves it."""
    if not root.is_dir():
        raise SourceError(str(root), "a folder", "a file" if root.exists() else "nothing", "give the folder itself")
    found = entries(root)
    for entry in found:
        if entry.leaves:
            raise SourceError(entry.name, "a file inside the folder", f"a link to {entry.path.resolve()}", "copy the file into it")
    refs = (FileRef(entry.name, digest(entry.path), entry.path.stat().st_size, entry.path) for entry in found)
    return FileTree(root.resolve().name, tuple(refs))


def cases(files: FileTree) -> list[CaseFiles]:
    """Every case, cropped ones first, then by video and frame. SourceError when there is none."""
    found: dict[tuple[str, str, str], dict[str, FileRef]] = {}
    for ref in files.files:
        parts = ref.name.removeprefix("data/").split("/")
        if len(parts) == 1 + DEPTH and parts[0] in PROTOCOLS:
            found.setdefault((parts[0], parts[1], parts[2]), {})[parts[3]] = ref
    listed = [CaseFiles(*key, found[key]) for key in sorted(found) if IMAGE in found[key]]
    if not listed:
        raise SourceError(files.name, f"cropped/<video>/<frame>/{IMAGE} or masks/<video>/<frame>/{IMAGE}", "none",
                          "give a folder in ActAffordance's layout, see docs/twohands/benchmark.md")
    return listed


def predictions(files: FileTree, protocol: str) -> Iterator[tuple[float | None, str, str, FileRef]]:
    """(threshold or None, <protocol>/<video>/<frame>, left or right, file) of every predicted mask; folders that do not say
    theirs are of `protocol`. SourceError when there is none, and for a threshold folder that is no number in 0..1.
    """
    empty = True
    for ref in files.files:
        parts = ref.name.split("/")
        side = {"aff_left.png": "left", "aff_right.png": "right"}.get(parts[-1])
        if side is None or len(parts) < DEPTH:
            continue
        *above, video, frame, _ = parts
        said = above.pop(0) if above and above[0] in PROTOCOLS else protocol
        yield _threshold(above, ref.name), f"{said}/{video}/{frame}", side, ref
        empty = False
    if empty:
        raise SourceError(files.name, "<video>/<frame>/aff_left.png or aff_right.png", "none",
                          "give the folder that holds the videos, or one folder per threshold that does; "
                          "see docs/twohands/benchmark.md")


def _threshold(above: list[str], name: str) -> float | None:
    if not above:
        return None
    number = THRESHOLD.search(above[0])
    if len(above) > 1 or number is None or float(number[0]) > 1:
        raise SourceError(name, "[masks|cropped/][<threshold 0..1>/]<video>/<frame>/aff_*.png", "/".join(above),
                          "let the name of a threshold's folder end in its number, e.g. 0.3")
    return float(number[0])
