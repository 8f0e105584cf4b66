"""Files of MediaPipe's palm detector and landmark network, which `make setup` puts into the environment.

The networks keep their licence (Apache-2.0, LICENSE beside them): this project neither commits nor publishes them. See
docs/decisions/041.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from schemas.files import FileRef, FileTree

FOLDER = "share/afford/mediapipe-0.10.21"
"""below the prefix of the environment, as in install/landmark_files.py"""
PALM, HAND = "palm_detection_full.tflite", "hand_landmark_full.tflite"
LABEL = "landmark_networks"


def landmark_files(digest: Callable[[Path], str], folder: str = "") -> FileTree | None:
    """List both networks with their content digests, as a leaf of the graph; None where set-up could not fetch them.

    folder: another folder of both files; ValueError when it lacks one.
    """
    place = Path(folder).expanduser().absolute() if folder else Path(sys.prefix) / FOLDER
    missing = [name for name in (PALM, HAND) if not (place / name).is_file()]
    if missing and folder:
        raise ValueError(f"{folder}: the folder has no {missing[0]}; name a folder with both files, or name none and run "
                         "`python install/landmark_files.py`")
    return None if missing else FileTree(LABEL, tuple(_ref(place / name, digest) for name in sorted((PALM, HAND))))


def _ref(path: Path, digest: Callable[[Path], str]) -> FileRef:
    return FileRef(path.name, digest(path), path.stat().st_size, path)
