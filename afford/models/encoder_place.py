"""Place of the image encoder that set-up fetched, found without loading torch: every run looks for it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from schemas.files import FileRef, FileTree

FILE = "efficientnet-lite0-57934424.pth"
"""published weights, as install/image_encoder.py fetches them"""
FOLDER = "share/afford/efficientnet-lite0-0.1.0"
"""below the prefix of the environment"""


def encoder_path() -> Path:
    """Place of the weights in the environment; set-up put them there, or could not."""
    return Path(sys.prefix) / FOLDER / FILE


def encoder_files(digest: Callable[[Path], str]) -> FileTree | None:
    """List the weights with their content digest, as a leaf of the graph; None where set-up could not fetch them."""
    path = encoder_path()
    return FileTree("image_encoder", (FileRef(FILE, digest(path), path.stat().st_size, path),)) if path.is_file() else None
