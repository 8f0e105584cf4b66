"""Files of data sets: digests, manifests, file trees, and atomic replacement of output folders."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from blake3 import blake3

from afford.common.errors import SourceError
from schemas.files import FileRef, FileTree

MANIFEST = "manifest.json"
FOOTER = "footer_blake3"
CHUNK_BYTES = 1 << 20
TAIL_BYTES = 8
"""bytes at the end of a Parquet file: the length of its footer and the magic number"""


def empty_folder(path: Path) -> Path:
    """Create an empty folder; delete what is in it, for example after a killed run."""
    if path.exists():
        shutil.rmtree(path)
    path.mkdir(parents=True)
    return path


def write_json(path: Path, content: Any) -> None:
    """Write indented UTF-8 JSON; NaN and infinity are refused."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def names(root: Path) -> list[str]:
    """List the files below root, sorted, with forward slashes."""
    return sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())


def sha256(path: Path) -> str:
    """Compute the SHA-256 hex digest of a file."""
    digest = hashlib.sha256()
    for chunk in _chunks(path):
        digest.update(chunk)
    return digest.hexdigest()


def write_manifest(root: Path) -> None:
    """Write manifest.json: size, sha256 and blake3 of every other file, and blake3 of the footer of every shard."""
    files = {name: _entry(root / name) for name in names(root) if name != MANIFEST}
    write_json(root / MANIFEST, {"files": files})


def _entry(path: Path) -> dict[str, Any]:
    entry = {"bytes": path.stat().st_size, "sha256": sha256(path), "blake3": _blake3(path)}
    return entry | ({FOOTER: footer_digest(path)} if path.suffix == ".parquet" else {})


def footer_digest(path: Path) -> str:
    """Compute the hex digest of the footer of a Parquet file: schema, categories and column offsets.

    The data pages have checksums of their own.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - TAIL_BYTES, 0))
        stated = int.from_bytes(file.read(TAIL_BYTES)[:4], "little")
        file.seek(max(size - TAIL_BYTES - stated, 0))
        return blake3(file.read()).hexdigest()


def tree(name: str, root: Path) -> FileTree:
    """Return all files below root as a FileTree."""
    refs = (FileRef(file, _blake3(root / file), (root / file).stat().st_size, root / file) for file in names(root))
    return FileTree(name, tuple(refs))


def _blake3(path: Path) -> str:
    digest = blake3()
    for chunk in _chunks(path):
        digest.update(chunk)
    return digest.hexdigest()


def _chunks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            yield chunk


def copy_folder(files: FileTree, marker: str, folder: Path) -> Path:
    """Copy the folder of a FileTree that contains the file `marker` ('config.json'), with its subfolders, into `folder`.

    Raises SourceError for a tree without such a file, or with several.
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


RECORD = "prediction.json"
"""file that marks a folder of predictions"""


def write_files(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Write the files of a prediction, RECORD among them, into `folder` and return the folder."""
    with replace_folder(folder) as partial:
        for name, data in files.items():
            write_verified(partial / name, data)
    return folder


@contextmanager
def replace_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder that replaces an earlier prediction when the block ends without an error."""
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
    """Write a file and compare it with what the disk returns; OSError when they differ."""
    path.write_bytes(data)
    if path.read_bytes() != data:
        raise OSError(f"{path}: expected the bytes that were written, read others; check the disk")


def _replace(partial: Path, folder: Path) -> None:
    """Move a folder to the place of another one, which is deleted after the move."""
    old = folder.with_name(f".{folder.name}.old-{os.getpid()}")
    if folder.exists():
        folder.rename(old)
    partial.rename(folder)
    shutil.rmtree(old, ignore_errors=True)
