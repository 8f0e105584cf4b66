"""Outputs of a run under names that people can find: read-only links into the store, replaced as a whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from runner import Runner

FILES = "files/"
"""where the codec keeps the files of a FileTree inside its artifact"""


def publish(runner: Runner, digest: str, folder: Path) -> Path:
    """Show the files of a FileTree artifact as `folder`; what was there before is replaced only when all is in place."""
    files = {name.removeprefix(FILES): path for name, path in runner.files(digest).items() if name.startswith(FILES)}
    partial = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    _place(files, partial)
    old = folder.with_name(f".{folder.name}.old-{os.getpid()}")
    if folder.exists():
        folder.rename(old)
    partial.rename(folder)
    shutil.rmtree(old, ignore_errors=True)
    return folder


def publish_file(runner: Runner, digest: str, path: Path) -> Path:
    """Show the only file of a FileTree artifact as `path`."""
    files = [file for name, file in runner.files(digest).items() if name.startswith(FILES)]
    if len(files) != 1:
        raise ValueError(f"artifact {digest[:12]}: expected one file, got {len(files)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial-{os.getpid()}")
    _link(files[0], partial)
    os.replace(partial, path)
    return path


def _place(files: Mapping[str, Path], folder: Path) -> None:
    for name, path in files.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        _link(path, target)
    folder.mkdir(parents=True, exist_ok=True)


def _link(source: Path, target: Path) -> None:
    """A hard link, or a copy where the file system has none between the two places."""
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
