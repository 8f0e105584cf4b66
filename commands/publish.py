"""Outputs of a run under names that people can find: read-only links into the store, replaced as a whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from runner import Runner

FILES = "files/"
"""where the codec keeps the files of a FileTree inside its artifact"""
LISTED = ".clips"
"""which recordings of clips a folder has, by name"""


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


def retire(folder: Path, made: set[str], whole: bool) -> None:
    """After the recordings of clips `made`, names of files, were put into `folder`: those of clips that a `whole` run no longer has
    are deleted; a run of some clips adds to the list. Nothing is deleted that is not on it."""
    listed = folder / LISTED
    before = set(listed.read_text(encoding="utf-8").splitlines()) if listed.exists() else set()
    for name in before - made if whole else ():
        (folder / name).unlink(missing_ok=True)
    partial = listed.with_name(f"{LISTED}.partial-{os.getpid()}")
    partial.write_text("".join(f"{name}\n" for name in sorted(made if whole else before | made)), encoding="utf-8")
    os.replace(partial, listed)


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
