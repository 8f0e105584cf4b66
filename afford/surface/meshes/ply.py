"""PLY and STL reader on trimesh; content that trimesh drops silently is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl

from afford.common.bounded import reason
from afford.common.errors import SourceError
from afford.surface.meshes.surface import Surface, check_corners, decode_picture, find_reference, plain_surface, with_corner_colours
from schemas.files import FileRef, FileTree

HEADER_BYTES = 1 << 16
COLOURED = re.compile(r"^property\s+\w+\s+red\s*$", re.MULTILINE)


def read_ply(files: FileTree, file: FileRef) -> Surface:
    """Read a surface with vertex or face colours, or with the image of a `TextureFile` comment."""
    with file.path.open("rb") as stream:
        header = stream.read(HEADER_BYTES).partition(b"end_header")[0].decode("latin-1")
    image = texture_name(header)
    # without an image vertices stay as they are numbered: their colours are in that order
    found = _load(load_ply, file, skip_materials=True, fix_texture=bool(image) or not COLOURED.search(header))
    faces = _triangles(found, file.name)
    surface, uv = _ordered(plain_surface(found["vertices"], faces), header), getattr(found.get("visual"), "uv", None)
    if image and uv is not None:
        place = find_reference(files, file.name, image)
        pixels = decode_picture(place.path.read_bytes(), place.name)
        return replace(surface, uv=np.asarray(uv, np.float64)[faces], images=(pixels,))
    face, vertex = found.get("face_colors"), found.get("vertex_colors")
    if vertex is not None:
        return with_corner_colours(surface, _bytes(vertex, len(surface.vertices), file.name)[faces])
    if face is not None and len(face) == len(faces):
        return with_corner_colours(surface, np.repeat(_bytes(face, len(faces), file.name)[:, None], 3, axis=1))
    return surface


def read_stl(files: FileTree, file: FileRef) -> Surface:
    """Read a grey surface; STL has no standard for colours."""
    found = _load(load_stl, file)
    if "faces" not in found:
        got = f"{len(found['geometry'])} of them" if found.get("geometry") else "no triangle, or another length than stated"
        raise SourceError(file.name, "one solid with triangles", got, "export the mesh again as binary STL")
    return plain_surface(found["vertices"], found["faces"])


def texture_name(header: str) -> str:
    """Return the image that the header of a PLY names; '' for none."""
    found = re.search(r"^comment\s+TextureFile\s+(.+?)\s*$", header, re.MULTILINE)
    return found.group(1) if found else ""


def _triangles(found: dict[str, Any], name: str) -> np.ndarray:
    """Return triangle corners (f, 3) int64; SourceError for a file without faces and for invalid indices."""
    faces = found.get("faces")
    if faces is None or not len(faces):
        raise SourceError(name, "faces", "points only", "export the mesh with its faces")
    try:
        quads = np.asarray(faces, np.int64)
        out = quads if quads.shape[1] == 3 else np.asarray(trimesh.geometry.triangulate_quads(quads), np.int64)
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        raise SourceError(name, "faces of 3 corners or more", reason(error), "export the file again") from error
    if out.ndim != 2 or out.shape[1] != 3:
        raise SourceError(name, "faces of 3 corners or more", f"an array {quads.shape}", "export the file again")
    vertices = found["vertices"]
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "uif":
        raise SourceError(name, "vertices of three numbers", f"{vertices.dtype} {vertices.shape}", "export the file again")
    check_corners(out, len(vertices), name)
    return out


def _load(reader, file: FileRef, **options):  # type: ignore[no-untyped-def]  # readers of trimesh have no common type
    try:
        with file.path.open("rb") as stream:
            return reader(stream, **options)
    except Exception as error:  # its readers fail in every way; all of them mean the same
        got = f"{type(error).__name__}: {reason(error)}"
        raise SourceError(file.name, "a readable mesh", got, "export the file again") from error


def _ordered(surface: Surface, header: str) -> Surface:
    """Drop the face numbers where polygons were triangulated, which loses the order of the file."""
    stated = re.search(r"^element\s+face\s+(\d+)", header, re.MULTILINE)
    same = stated is not None and int(stated.group(1)) == len(surface.faces)
    return surface if same else replace(surface, line=np.full(len(surface.faces), -1))


def _bytes(colours: np.ndarray, count: int, name: str) -> np.ndarray:
    """Convert `count` colours 0..255 (integers) or 0..1 (floats) to (n, 3) uint8; SourceError for other values."""
    values = np.asarray(colours)
    if values.ndim != 2 or len(values) != count or values.shape[1] < 3 or values.dtype.kind not in "uif":
        got = f"{values.dtype} {values.shape}"
        raise SourceError(name, f"{count} colours of red, green and blue", got, "export the mesh again")
    values = values[:, :3]
    return values.astype(np.uint8) if values.dtype.kind in "ui" else np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)
