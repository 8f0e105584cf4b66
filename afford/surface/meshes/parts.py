"""Part label files: `<mesh file name>.parts.json` (docs/surface/mesh-format.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from afford.common.bounded import TooLargeError
from afford.common.errors import SourceError
from afford.common.text import json_field, parse_json
from afford.surface.meshes.surface import LABELS, Surface
from schemas.files import FileTree

FIX = "see docs/surface/mesh-format.md"
MAX_PARTS = 1000
"""largest number of parts of one object"""
KEYS = {"version", "category", "parts", "groups"}


@dataclass(frozen=True, eq=False)
class PartLabels:
    """Part labels of the faces of a surface."""

    category: str
    """'' if the file names none"""
    names: tuple[str, ...]
    part: np.ndarray
    """(f,) int16 index into `names`, -1 for a face without a label"""


def read_labels(files: FileTree, mesh_name: str, surface: Surface) -> PartLabels:
    """Read the labels of a surface; empty without a label file. SourceError for violations of the format."""
    file = files.find(mesh_name + LABELS)
    if file is None:
        return PartLabels("", (), np.full(len(surface.faces), -1, np.int16))
    tree = parse_json(file.path.read_bytes(), file.name)
    _check(tree, file.name)
    ways = [key for key in ("parts", "groups") if key in tree]
    if len(ways) != 1:
        raise SourceError(file.name, "either 'parts' or 'groups'", " and ".join(ways) or "neither", FIX)
    named = json_field(tree, ways[0], dict, file.name)
    if len(named) > MAX_PARTS:
        raise TooLargeError(f"{file.name}, {ways[0]}", f"at most {MAX_PARTS} parts", str(len(named)), FIX)
    give = _by_range if ways[0] == "parts" else _by_group
    part = np.full(len(surface.faces), -1, np.int16)
    for index, (name, value) in enumerate(named.items()):
        where = f"{file.name}, {ways[0]}.{name}"
        if not name or not isinstance(value, list) or not value:
            raise SourceError(where, "a part name with a list that is not empty", repr(value), FIX)
        chosen = give(value, surface, where)
        taken = part[chosen][part[chosen] >= 0]
        if len(taken):
            other = tuple(named)[int(taken[0])]
            raise SourceError(where, "faces that no other part has", f"{len(taken)} faces of {other!r} as well", FIX)
        part[chosen] = index
    return PartLabels(tree.get("category", ""), tuple(named), part)


def _check(tree: Any, name: str) -> None:
    if not isinstance(tree, dict):
        raise SourceError(name, "an object with fields", type(tree).__name__, FIX)
    unknown = sorted(set(tree) - KEYS)
    if unknown:
        raise SourceError(name, f"the fields {', '.join(sorted(KEYS))}", ", ".join(unknown), FIX)
    if tree.get("version") != 1 or isinstance(tree.get("version"), bool):
        raise SourceError(f"{name}, field 'version'", "1", repr(tree.get("version")), FIX)
    if not isinstance(tree.get("category", ""), str):
        raise SourceError(f"{name}, field 'category'", "a word", repr(tree["category"]), FIX)


def _by_range(ranges: list[Any], surface: Surface, where: str) -> np.ndarray:
    """Find triangles (f,) bool of the faces in half-open ranges."""
    if (surface.line < 0).any():
        raise SourceError(where, "a file of triangles, whose order is kept", "one with other polygons", "triangulate it first")
    count = int(surface.line.max()) + 1
    chosen = np.zeros(count, bool)
    for pair in ranges:
        good = isinstance(pair, list) and len(pair) == 2 and all(type(number) is int for number in pair)
        if not good or not 0 <= pair[0] < pair[1] <= count:
            raise SourceError(where, f"ranges [first, end) within 0..{count}", repr(pair), FIX)
        if chosen[pair[0] : pair[1]].any():
            raise SourceError(where, "ranges that do not overlap", repr(pair), FIX)
        chosen[pair[0] : pair[1]] = True
    return chosen[surface.line]


def _by_group(names: list[Any], surface: Surface, where: str) -> np.ndarray:
    """Find triangles (f,) bool of the groups."""
    there, wanted = set(surface.groups), {name for name in names if isinstance(name, str)}
    unknown = [name for name in names if not isinstance(name, str) or name not in there]
    if unknown:
        known = ", ".join(repr(name) for name in dict.fromkeys(surface.groups) if name)
        raise SourceError(where, f"groups of the mesh ({known or 'it has none'})", repr(unknown[0]), FIX)
    chosen = np.array([name in wanted for name in surface.groups])
    return np.asarray(chosen[surface.group])
