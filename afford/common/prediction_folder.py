"""The folder of one prediction: written aside, then put in the place of an earlier one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from afford.common.errors import SourceError
from afford.common.files import empty_folder

RECORD = "prediction.json"
"""the file that makes a folder one of predictions"""


def write_files(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Write a prediction's files, RECORD among them, into `folder` and return it, as `write` does."""
    with replace_folder(folder) as partial:
        for name, data in files.items():
            write_verified(partial / name, data)
    return folder


@contextmanager
def replace_folder(folder: Path) -> Iterator[Path]:
    """A folder aside, which takes the place of an earlier prediction when all is in it."""
    if folder.exists() and not (folder / RECORD).is_file():
        raise SourceError(str(folder), "an earlier prediction or nothing", "something else", "give another --out")
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = empty_folder(folder.with_name(f".{folder.name}.partial-{os.getpid()}"))
    try:
        yield partial
        _replace(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_verified(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    if path.read_bytes() != data:
        raise OSError(f"{path}: expected the bytes that were written, read others; check the disk")


def _replace(partial: Path, folder: Path) -> None:
    """Put a folder in the place of another, which is deleted only when the new one is there."""
    old = folder.with_name(f".{folder.name}.old-{os.getpid()}")
    if folder.exists():
        folder.rename(old)
    partial.rename(folder)
    shutil.rmtree(old, ignore_errors=True)
