"""Storage of a schema value: value.json for its tree with pooled arrays beside it, or symbolic links for a FileTree.

Loading runs the checks of the schema; a list of `LAZY_FIELDS` is read and checked when it is iterated. No pickle is used.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from afford.codecs.kinds import LAZY_FIELDS, LazyTuple, kinds
from afford.codecs.pools import Reader, Writer
from schemas.files import FileRef, FileTree

VALUE, FILES = "value.json", "files"


def save(value: object, folder: Path) -> None:
    """Write a schema value into an empty folder. The files of a FileTree become symbolic links to their paths."""
    if isinstance(value, FileTree):
        _link(value, folder)
    writer = Writer(folder)
    tree = _tree(value, writer, "", {})
    writer.close()
    text = json.dumps(tree, ensure_ascii=True, separators=(",", ":"), sort_keys=True, allow_nan=False)
    (folder / VALUE).write_text(text, encoding="ascii")


def load(kind: str, files: Mapping[str, Path]) -> Any:
    """Read a value from its files by name. Raises ValueError when the files are of another kind."""
    tree = json.loads(files[VALUE].read_text(encoding="ascii"))
    if not isinstance(tree, dict) or tree.get("of") != kind:
        raise ValueError(f"{VALUE}: expected a {kind}, got {tree.get('of') if isinstance(tree, dict) else type(tree).__name__}")
    reader, left = Reader(files), LAZY_FIELDS.get(kind, "")
    if not left:
        return _value(tree, reader, files)
    shelf = LazyTuple(len(tree["fields"].pop(left)), partial(_walk, left, dict(files)), tuple(files.values()))
    return kinds()[kind](**{name: _value(part, reader, files) for name, part in tree["fields"].items()}, **{left: shelf})


def _walk(field: str, files: Mapping[str, Path]) -> Iterator[Any]:
    """Yield the elements of a list that was left on disk."""
    reader = Reader(files)
    for item in json.loads(files[VALUE].read_text(encoding="ascii"))["fields"][field]:
        yield _value(item, reader, files)


def load_folder(folder: Path) -> Any:
    """Read the value that `save` wrote into a folder, of any kind."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return load(json.loads(files[VALUE].read_text(encoding="ascii"))["of"], files)


def _link(tree: FileTree, folder: Path) -> None:
    for file in tree.files:
        link = folder / FILES / file.name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(file.path.absolute())


def _tree(value: object, writer: Writer, path: str, meta: Mapping[str, Any]) -> Any:
    """Convert a value to JSON and pass its arrays to the writer; `path` is the field, e.g. 'rgb' or 'samples.3.image_jpeg'."""
    if isinstance(value, np.ndarray):
        return writer.put(path, value, meta.get("encoding", "raw"))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field for field in dataclasses.fields(value) if field.type != "Path"]
        parts = {f.name: _tree(getattr(value, f.name), writer, f"{path}.{f.name}".lstrip("."), f.metadata) for f in fields}
        return {"of": type(value).__name__, "fields": parts}
    if isinstance(value, (tuple, LazyTuple)):
        return [_tree(item, writer, f"{path}.{i}", meta) for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise TypeError(f"{path}: expected a schema, array, tuple, str, int, float, bool or None, got {type(value).__name__}")


def _value(tree: Any, reader: Reader, files: Mapping[str, Path]) -> Any:
    if isinstance(tree, list):
        return tuple(_value(item, reader, files) for item in tree)
    if not isinstance(tree, dict):
        return tree
    if "float" in tree:
        return float(tree["float"])
    if "of" not in tree:
        return reader.get(tree)
    parts = {name: _value(part, reader, files) for name, part in tree["fields"].items()}
    if tree["of"] == FileRef.__name__:
        parts["path"] = files[f"{FILES}/{parts['name']}"]
    return kinds()[tree["of"]](**parts)
