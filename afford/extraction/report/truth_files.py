"""The truth folder of a rendered clip, as a value."""

from __future__ import annotations

from pathlib import PurePosixPath

from afford.codecs import load
from schemas.files import FileTree
from schemas.scene import ClipTruth


def load_truth(tree: FileTree) -> ClipTruth:
    """Read `truth/<video_id>/` (docs/synthetic/truth-format.md); ValueError names the file when one is missing."""
    files = {PurePosixPath(file.name).name: file.path for file in tree.files}
    if "value.json" not in files:
        raise ValueError(f"truth of {tree.name}: expected value.json among {sorted(files)}; see docs/synthetic/truth-format.md")
    value = load("ClipTruth", files)
    if not isinstance(value, ClipTruth):
        raise ValueError(f"truth of {tree.name}: expected a ClipTruth, got {type(value).__name__}")
    return value
