"""OBJ and MTL reader that keeps the order of faces and groups.

No library is used, because part labels refer to the order of faces and to groups, and because an unreadable line must be an error.
Polygons are triangulated as fans; curves, normals and smoothing groups are ignored.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from afford.common.errors import SourceError
from afford.surface.meshes.surface import GREY, PictureCache, Surface, decode_text, find_reference
from schemas.files import FileRef, FileTree

INDEX = re.compile(r"[0-9]{1,18}")


@dataclass
class _Lines:
    """Statements of a file, by kind."""

    v: list[list[str]] = field(default_factory=list)
    vt: list[list[str]] = field(default_factory=list)
    polygons: list[list[str]] = field(default_factory=list)
    at: list[int] = field(default_factory=list)
    """line number of each polygon"""
    material: list[int] = field(default_factory=list)
    group: list[int] = field(default_factory=list)
    materials: dict[str, int] = field(default_factory=lambda: {"": 0})
    groups: dict[str, int] = field(default_factory=lambda: {"": 0})
    libraries: list[str] = field(default_factory=list)


def read_obj(files: FileTree, file: FileRef) -> Surface:
    """Read a surface; SourceError gives the line of an unreadable statement."""
    lines = _sort(decode_text(file))
    vertices, has_colour = _vertices(lines.v, file.name)
    coords = _numbers(lines.vt, 2, file.name, "vt")
    corner, texel, polygon = _obj_triangles(lines, file.name, len(vertices), len(coords))
    material, group = np.asarray(lines.material, np.int64)[polygon], np.asarray(lines.group, np.int64)[polygon]
    images, missing = _images(files, file, lines)
    uv = np.where(texel[..., None] >= 0, np.concatenate([coords, np.zeros((1, 2))])[texel], 0.0)
    big = np.array([image.size > 3 for image in images])
    bare = int((big[material] & (texel < 0).any(axis=1)).sum())
    notes = (("faces without texture coordinates under an image", bare),) if bare else ()
    colour = np.round(vertices[corner, 3:] * 255).astype(np.uint8) if has_colour else np.zeros((len(corner), 3, 3), np.uint8)
    paint = np.where(big[material] | (material != 0), material, -1) if has_colour else material
    if missing:
        raise SourceError(file.name, f"the material {missing!r} in {', '.join(lines.libraries)}", "no such material",
                          "export the MTL file again")
    return Surface(vertices[:, :3], corner, uv, paint, images, colour, polygon, group, tuple(lines.groups), notes)


def _sort(content: str) -> _Lines:
    out, material, group = _Lines(), 0, 0
    for number, line in enumerate(content.replace("\\\r\n", " ").replace("\\\n", " ").splitlines(), 1):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            out.v.append(words[1:])
        elif words[0] == "vt":
            out.vt.append(words[1:3] if len(words) > 2 else [*words[1:2], "0"])
        elif words[0] == "f":
            named = words[1:]
            if "-" in line:
                named = [_absolute(word, len(out.v), len(out.vt)) for word in named]
            out.polygons.append(named)
            out.at.append(number)
            out.material.append(material)
            out.group.append(group)
        elif words[0] == "usemtl":
            material = out.materials.setdefault(" ".join(words[1:]), len(out.materials))
        elif words[0] in ("g", "o"):
            group = out.groups.setdefault(" ".join(words[1:]), len(out.groups))
        elif words[0] == "mtllib":
            out.libraries.append(line.partition(words[0])[2].strip())
    return out


def _absolute(word: str, vertices: int, coords: int) -> str:
    """Convert negative (relative) indices of a corner to positive ones."""
    parts = word.split("/")
    for k, count in enumerate((vertices, coords)[: len(parts)]):
        if parts[k].startswith("-"):
            parts[k] = str(count + 1 + int(parts[k])) if INDEX.fullmatch(parts[k][1:]) else parts[k]
    return "/".join(parts)


def _numbers(rows: list[list[str]], width: int, name: str, word: str) -> np.ndarray:
    try:
        return np.array(rows, np.float64).reshape(-1, width)
    except ValueError as error:
        got = str(error).splitlines()[0]
        raise SourceError(name, f"{word} lines with {width} numbers", got, "export the file again") from error


def _vertices(rows: list[list[str]], name: str) -> tuple[np.ndarray, bool]:
    """Return (v, 3), or (v, 6) with colours 0..1 if every vertex has one."""
    lengths = {len(row) for row in rows}
    if lengths == {6}:
        out = _numbers(rows, 6, name, "v")
        return np.concatenate([out[:, :3], np.clip(out[:, 3:], 0, 1)], axis=1), True
    if lengths <= {3, 4}:
        return _numbers([row[:3] for row in rows], 3, name, "v"), False
    raise SourceError(name, "v lines with 3 numbers, or all with 6 (position and colour)", f"lines with {sorted(lengths)}",
                      "export the file again")


def _obj_triangles(lines: _Lines, name: str, vertices: int, coords: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (f, 3) vertex and texture indices from 0 (-1 none), and the polygon of each triangle."""
    sizes = np.array([len(polygon) for polygon in lines.polygons], np.int64)
    if len(sizes) and sizes.min() < 3:
        raise SourceError(f"{name}, line {lines.at[int(sizes.argmin())]}", "a face with 3 corners or more", f"{sizes.min()}",
                          "export the file again")
    split = [word.split("/") for polygon in lines.polygons for word in polygon]
    try:
        v = np.array([int(parts[0]) for parts in split], np.int64)
        vt = np.array([int(parts[1]) if len(parts) > 1 and parts[1] else 0 for parts in split], np.int64)
    except (ValueError, OverflowError) as error:
        raise SourceError(name, "f lines with corners v, v/vt, v//vn or v/vt/vn", str(error), "export the file again") from error
    for index, count, word in ((v, vertices, "v"), (vt, coords, "vt")):
        bad = (index > count) | (index < (1 if word == "v" else 0))
        if bad.any():
            line = lines.at[int(np.searchsorted(np.cumsum(sizes), int(bad.argmax()), side="right"))]
            raise SourceError(f"{name}, line {line}", f"{word} indices 1..{count}", str(index[bad][0]), "export the file again")
    polygon = np.repeat(np.arange(len(sizes)), np.maximum(sizes - 2, 0))
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])[polygon] if len(sizes) else np.zeros(0, np.int64)
    step = np.arange(len(polygon)) - np.concatenate([[0], np.cumsum(sizes - 2)[:-1]])[polygon] if len(sizes) else first
    corners = np.stack([first, first + step + 1, first + step + 2], axis=1)
    return v[corners] - 1, vt[corners] - 1, polygon


def _images(files: FileTree, file: FileRef, lines: _Lines) -> tuple[tuple[np.ndarray, ...], str]:
    """Return the image of each material (grey without a library), and the name of a missing material."""
    known: dict[str, np.ndarray] = {"": np.asarray(GREY, np.uint8).reshape(1, 1, 3)}
    pictures = PictureCache()
    for library in reversed(dict.fromkeys(reversed(lines.libraries))):  # each once; of one name the last counts
        known |= read_mtl(files, find_reference(files, file.name, library), pictures)
    used = set(lines.material)
    wanted = {name for name, index in lines.materials.items() if index in used}
    missing = next((name for name in lines.materials if name in wanted and name not in known), "") if lines.libraries else ""
    return tuple(known.get(name, known[""]) for name in lines.materials), missing


OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1, "-boost": 1, "-bm": 1}
"""options of `map_Kd` that change no colour -> number of their arguments"""


def image_name(rest: str, where: str) -> str:
    """Parse the file name in the value of `map_Kd`; SourceError for options that move or scale the image."""
    words = rest.split()
    while words and words[0].startswith("-"):
        if words[0] not in OPTIONS:
            raise SourceError(where, f"map_Kd with no options but {', '.join(OPTIONS)}", words[0],
                              "apply it to the texture coordinates when exporting")
        words = words[1 + OPTIONS[words[0]]:]
    if not words:
        raise SourceError(where, "a file name after map_Kd", "nothing", "name the image or remove the line")
    return " ".join(words)


def mtl_statements(content: str) -> list[tuple[int, str, str]]:
    """Return line number, keyword and arguments of every statement."""
    split = [(number, *line.strip().partition(" ")[::2]) for number, line in enumerate(content.replace("\t", " ").splitlines(), 1)]
    return [(number, word, rest.strip()) for number, word, rest in split if word and not word.startswith("#")]


def read_mtl(files: FileTree, mtl: FileRef, pictures: PictureCache) -> dict[str, np.ndarray]:
    """Map material names to (h, w, 3) uint8 sRGB images, (1, 1, 3) for a plain diffuse colour.

    Images are read through `pictures`.
    """
    found: dict[str, np.ndarray] = {}
    mapped: set[str] = set()
    name = ""
    for number, word, rest in mtl_statements(decode_text(mtl)):
        where = f"{mtl.name}, line {number}"
        if word == "newmtl":
            name = rest
            found[name] = np.asarray(GREY, np.uint8).reshape(1, 1, 3)
        elif word in ("map_Kd", "Kd") and not name:
            raise SourceError(where, "newmtl first", word, "is the file cut short? export it again")
        elif word == "map_Kd":
            image = find_reference(files, mtl.name, image_name(rest, where))
            found[name] = pictures.read(image)
            mapped.add(name)
        elif word == "Kd" and name not in mapped:
            found[name] = _diffuse_colour(rest, where)
    return found


def _diffuse_colour(rest: str, where: str) -> np.ndarray:
    try:
        values = np.array([float(word) for word in rest.split()[:3]])
        if len(values) != 3 or not ((values >= 0) & (values <= 1)).all():
            raise ValueError(rest)
    except ValueError as error:
        raise SourceError(where, "Kd with three numbers 0..1", repr(rest), "export the materials again") from error
    return np.round(values * 255).astype(np.uint8).reshape(1, 1, 3)
