"""A FileTree as a real folder again, for readers that want one."""

from __future__ import annotations

import shutil
from pathlib import Path

from afford.common.errors import SourceError
from schemas.files import FileTree


def copy_folder(files: FileTree, marker: str, folder: Path) -> Path:
    """Copy the files beside the one whose name ends in `marker` ('config.json') into `folder`, with those
    below them. SourceError when there is no such file, or several.
    """
    found = [ref.name for ref in files.files if ref.name.rpartition("/")[2] == marker]
    heads = sorted({name.removesuffix(marker) for name in found}, key=len)
    if not heads or (len(heads) > 1 and not all(head.startswith(heads[0]) for head in heads)):
        raise SourceError(files.name, f"one folder with a {marker}", ", ".join(found) or "none", "give the output of its stage")
    for ref in files.files:
        if ref.name.startswith(heads[0]):
            copy = folder / ref.name.removeprefix(heads[0])
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ref.path, copy)
    return folder
