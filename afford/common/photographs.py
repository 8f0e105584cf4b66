"""Photographs of the user without hands, which become backgrounds of the hand finder's lessons."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from schemas.files import FileRef, FileTree

PHOTOGRAPH_PX = 720
"""photographs are reduced to this width"""
SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
LABEL = "photographs"


def photograph_files(folder: Path, digest: Callable[[Path], str]) -> FileTree:
    """List the photographs in a folder and below with their content digests. ValueError when there are none."""
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    if not found:
        raise ValueError(f"{folder.name}: expected a folder of photographs without hands ({', '.join(SUFFIXES)}), found none; "
                         "choose another folder")  # fmt: skip
    return FileTree(LABEL, tuple(
        FileRef(path.relative_to(folder).as_posix(), digest(path), path.stat().st_size, path) for path in found))  # fmt: skip


def read_photographs(files: FileTree) -> tuple[np.ndarray, ...]:
    """Read photographs as (h, w, 3) uint8, at most PHOTOGRAPH_PX wide. ValueError names one that is not readable."""
    return tuple(_read(file) for file in files.files)


def _read(file: FileRef) -> np.ndarray:
    picture = cv2.imread(str(file.path), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError(f"{file.name}: this photograph is not readable; remove it from the folder of photographs")
    scale = PHOTOGRAPH_PX / picture.shape[1]
    reduced = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else picture
    return np.ascontiguousarray(reduced[..., ::-1])
