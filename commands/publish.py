"""Publish outputs under readable names: read-only links into the store, replaced atomically.

One process at a time publishes into a folder, under a lease in the store. A reader always finds either the old or the new folder,
because one system call exchanges them (renameat2 with RENAME_EXCHANGE, Linux). Without such a call (macOS, some network file
systems), two renames under the lease replace it, and the name is absent between them. Temporary names carry host, process and a
random id; the next process that publishes there deletes leftovers of killed runs.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from runner import Runner, StoreError
from runner.canonical import digest as tagged
from runner.files import unique
from runner.lease import Lease

FILES = "files/"
"""prefix of the files of a FileTree inside its artifact"""
LISTED = ".clips"
"""file that lists the recordings of clips in a folder"""
RECORDING = re.compile(r"[^./\0][^/\0]*\.mcap")
"""names in that list that may be deleted: plain names in the folder itself"""
LEFTOVER = re.compile(r"\..+\.(partial|old)[.-](\d+|[\w-]+-\d+-[0-9a-f]{8})")
"""temporary names, including those of earlier versions with only a process id"""
NAME_LETTERS = 40
"""maximum length of the name inside a temporary name, for the limits of file systems"""
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Linux constants: paths relative to the working directory; exchange of two names"""
NO_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM)
"""errors of systems and file systems that cannot exchange two names"""
PATIENCE_S = 0.002


@contextmanager
def publish_lock(store: Path, folder: Path) -> Iterator[None]:
    """Lock `folder` for publishing, and keep garbage collection away.

    Leftovers of killed runs are deleted first. StoreError when something cannot be written.
    """
    where = folder.relative_to(store).as_posix() if folder.is_relative_to(store) else str(folder.absolute())
    own = f"publish-{tagged('afford-publish', where)[:32]}.lock"
    try:
        with _leased(store / "leases" / "store.lock", shared=True), _leased(store / "leases" / own):
            folder.mkdir(parents=True, exist_ok=True)
            for name in [name for name in os.listdir(folder) if LEFTOVER.fullmatch(name)]:
                _delete(folder / name)
            yield
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(error.errno, f"{folder} could not be published to ({error}); the outputs are kept in the store; fix "
                                      "this and run again") from error


def publish(runner: Runner, digest: str, folder: Path) -> Path:
    """Publish the files of a FileTree artifact as `folder`.

    The old folder is replaced once the new one is complete, and left alone if it is identical. LostError when a file is
    damaged, StoreError when the folder cannot be written.
    """
    files = _files(runner, digest)
    with publish_lock(runner.store.root, folder.parent):
        if not _shows(folder, files):
            with _partial(folder) as partial:
                _place(files, partial)
                _swap(partial, folder)
    return folder


def publish_file(runner: Runner, digest: str, path: Path) -> Path:
    """Publish the only file of a FileTree artifact as `path`. Errors as `publish_files`."""
    publish_files(runner, {path.name: digest}, path.parent)
    return path


def publish_files(runner: Runner, made: Mapping[str, str], folder: Path) -> None:
    """Publish the only file of each FileTree artifact under its name in `folder`.

    Other files in the folder, and names that are already current, are left alone. ValueError for an artifact with several
    files, LostError and StoreError as `publish`.
    """
    sources = {name: _only(runner, digest) for name, digest in made.items()}
    with publish_lock(runner.store.root, folder):
        for name, source in sources.items():
            if not _same(folder / name, source):
                with _partial(folder / name) as partial:
                    _link(source, partial)
                    os.replace(partial, folder / name)


def publish_text(runner: Runner, text: str, path: Path) -> Path:
    """Write a page about several artifacts atomically. StoreError when it cannot be written."""
    with publish_lock(runner.store.root, path.parent):
        _write(path, text)
    return path


def shows_folder(runner: Runner, digest: str, folder: Path) -> bool:
    """Return True when `folder` contains this FileTree artifact and nothing else. No file is read."""
    return _shows(folder, _named(runner.unverified_files(digest)))


def shows_file(runner: Runner, digest: str, path: Path) -> bool:
    """Return True when `path` is the only file of this FileTree artifact. No file is read."""
    return any(_same(path, file) for file in _named(runner.unverified_files(digest)).values())


def retire_recordings(folder: Path, made: set[str], whole: bool) -> None:
    """Update the list of recordings after those of `made` were published, under `publish_lock`.

    After a `whole` run, recordings of clips that no longer exist are deleted; a run of some clips adds to the list. Only listed
    files with the name of a recording in the folder itself are deleted.
    """
    listed = folder / LISTED
    lines = listed.read_text(encoding="utf-8", errors="replace").splitlines() if listed.is_file() else []
    before = {name for name in lines if RECORDING.fullmatch(name)}
    for name in before - made if whole else ():
        (folder / name).unlink(missing_ok=True)
    _write(listed, "".join(f"{name}\n" for name in sorted(made if whole else before | made)))


@contextmanager
def _leased(path: Path, shared: bool = False) -> Iterator[None]:
    """Wait for a lease, and hold it."""
    while not (lease := Lease(path, shared)).held:
        time.sleep(PATIENCE_S)
    try:
        yield
    finally:
        lease.release(remove=not shared)


def _files(runner: Runner, digest: str) -> dict[str, Path]:
    return _named(runner.files(digest))


def _named(files: Mapping[str, Path]) -> dict[str, Path]:
    return {name.removeprefix(FILES): path for name, path in files.items() if name.startswith(FILES)}


def _only(runner: Runner, digest: str) -> Path:
    files = list(_files(runner, digest).values())
    if len(files) != 1:
        raise ValueError(f"artifact {digest[:12]}: expected one file, got {len(files)}")
    return files[0]


def _shows(folder: Path, files: Mapping[str, Path]) -> bool:
    if folder.is_symlink() or not folder.is_dir():
        return False
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()}
    return there == set(files) and all(_same(folder / name, path) for name, path in files.items())


def _same(target: Path, source: Path) -> bool:
    """Return True when a name is a hard link to a file in the store.

    Linking again would change the file's change time, and the next run would hash it again.
    """
    return target.is_file() and not target.is_symlink() and target.samefile(source)


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """Temporary name next to `path`, removed afterwards, also after an error."""
    partial = _temporary(path, "partial")
    try:
        yield partial
    finally:
        if os.path.lexists(partial):
            _delete(partial)


def _temporary(path: Path, kind: str) -> Path:
    return path.with_name(unique(f"{path.name[:NAME_LETTERS]}.{kind}"))


def _place(files: Mapping[str, Path], folder: Path) -> None:
    folder.mkdir()
    for name, path in files.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        _link(path, target)


def _link(source: Path, target: Path) -> None:
    """Create a hard link, or a copy where the file system does not support links between the two places."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _write(path: Path, text: str) -> None:
    with _partial(path) as partial:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)


def _swap(new: Path, folder: Path) -> None:
    """Put `new` in the place of `folder`; the old folder ends under the name of `new`, or is deleted."""
    if not os.path.lexists(folder):
        new.rename(folder)
    elif not _exchange(new, folder):
        old = _temporary(folder, "old")
        folder.rename(old)
        new.rename(folder)
        _delete(old)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names atomically; False where the system or the file system cannot."""
    call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if call is None:
        return False
    if call(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), ctypes.c_uint(RENAME_EXCHANGE)) == 0:
        return True
    code = ctypes.get_errno()
    if code in NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(other))


def _delete(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
