"""Surface of a mesh file: triangles in the order of the file, with their images and colours, and the files of one object.

References between files never leave the source folder.
"""

from __future__ import annotations

import io
import posixpath
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from PIL import Image

from afford.common.bounded import IMAGE_ERRORS, TooLargeError, check_image, reason
from afford.common.errors import SourceError
from schemas.files import FileRef, FileTree

GREY = (190, 190, 190)
"""sRGB of a face without a colour"""
MAX_TRIANGLES = 10_000_000
"""largest number of triangles of one object, with every copy of a mesh; 110 bytes each, and 60,000 are kept"""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a file before any repair."""

    vertices: np.ndarray
    """(v, 3) float64 in the unit of the file"""
    faces: np.ndarray
    """(f, 3) int64 vertex indices"""
    uv: np.ndarray
    """(f, 3, 2) float64 texture coordinates of each corner, v upwards; beyond 0..1 the image repeats"""
    paint: np.ndarray
    """(f,) int64 index into `images`; -1: the face has corner colours"""
    images: tuple[np.ndarray, ...]
    """(h, w, 3) uint8 sRGB; (1, 1, 3) for a plain material"""
    colour: np.ndarray
    """(f, 3, 3) uint8 sRGB corner colours, read where `paint` is -1"""
    line: np.ndarray
    """(f,) int64 face of the file that a triangle was cut from; -1 for a format without an order of faces"""
    group: np.ndarray
    """(f,) int64 index into `groups`"""
    groups: tuple[str, ...]
    """names of OBJ groups, glTF nodes or URDF links"""
    notes: tuple[tuple[str, int], ...] = ()
    """content that the reader dropped, and how often"""
    unit: str = ""
    """m if the format defines it, '' otherwise"""


def plain_surface(vertices: np.ndarray, faces: np.ndarray, colour: Sequence[int] = GREY, group: str = "") -> Surface:
    """Create a surface of one colour."""
    count = len(faces)
    image = np.asarray(colour, np.uint8).reshape(1, 1, 3)
    return Surface(np.asarray(vertices, np.float64).reshape(-1, 3), np.asarray(faces, np.int64).reshape(-1, 3),
                   np.zeros((count, 3, 2)), np.zeros(count, np.int64), (image,), np.zeros((count, 3, 3), np.uint8),
                   np.arange(count), np.zeros(count, np.int64), (group,))  # fmt: skip


def with_corner_colours(surface: Surface, colours: np.ndarray) -> Surface:
    """Replace the images by corner colours (f, 3, 3) uint8."""
    return replace(surface, paint=np.full(len(surface.faces), -1), colour=np.asarray(colours, np.uint8), images=())


def transform_surface(surface: Surface, T: np.ndarray) -> Surface:
    """Apply an affine (4, 4) transform; the faces of a mirrored surface are flipped."""
    placed = replace(surface, vertices=surface.vertices @ T[:3, :3].T + T[:3, 3])
    if np.linalg.det(T[:3, :3]) > 0:
        return placed
    return replace(placed, faces=placed.faces[:, ::-1], uv=placed.uv[:, ::-1], colour=placed.colour[:, ::-1])


def check_triangles(count: int, name: str) -> None:
    """Raise TooLargeError for more triangles than one object may have."""
    if count > MAX_TRIANGLES:
        raise TooLargeError(name, f"at most {MAX_TRIANGLES:,} triangles", f"{count:,}", "simplify the mesh, or use fewer copies")


def check_corners(faces: np.ndarray, vertices: int, name: str) -> None:
    """Raise SourceError for a face with an invalid vertex index."""
    if faces.size and (faces.min() < 0 or faces.max() >= vertices):
        bad = faces.max() if faces.min() >= 0 else faces.min()
        raise SourceError(name, f"vertex indices 0..{vertices - 1}", str(bad), "export the mesh again")


def join_surfaces(surfaces: Sequence[Surface], unit: str) -> Surface:
    """Join surfaces in order; faces, images and groups are renumbered consecutively."""
    if len(surfaces) == 1:
        return replace(surfaces[0], unit=unit)
    corners, images, groups, lines = ([0] for _ in range(4))
    for s in surfaces[:-1]:
        corners.append(corners[-1] + len(s.vertices))
        images.append(images[-1] + len(s.images))
        groups.append(groups[-1] + len(s.groups))
        lines.append(lines[-1] + int(s.line.max(initial=-1)) + 1)
    shifted = [
        (s.faces + c, np.where(s.paint < 0, -1, s.paint + i), s.group + g, np.where(s.line < 0, -1, s.line + n))
        for s, c, i, g, n in zip(surfaces, corners, images, groups, lines, strict=True)
    ]
    faces, paint, group, line = (np.concatenate(column) for column in zip(*shifted, strict=True))
    vertices, uv, colour = (np.concatenate([getattr(s, name) for s in surfaces]) for name in ("vertices", "uv", "colour"))
    return Surface(vertices, faces, uv, paint, tuple(chain(*(s.images for s in surfaces))), colour, line, group,
                   tuple(chain(*(s.groups for s in surfaces))), tuple(chain(*(s.notes for s in surfaces))), unit)  # fmt: skip


MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")
URDF = ".urdf"
LABELS = ".parts.json"
MAX_TEXELS = 1 << 27
"""pixels of all images of one object: two of 8192 x 8192, the largest that renderers accept; 400 MB as RGB"""
SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*:")


def suffix(name: str) -> str:
    """Return the suffix of a file name in lower case, with its dot."""
    return posixpath.splitext(name)[1].lower()


def resolve_reference(base: str, reference: str) -> str:
    """Return the root-relative name of `reference` in the file `base`; SourceError outside the source."""
    path = reference.strip().strip('"').replace("\\", "/")
    name = posixpath.normpath(posixpath.join(posixpath.dirname(base), path))
    if SCHEME.match(path) or path.startswith("/") or name == ".." or name.startswith("../"):
        raise SourceError(base, "references to files inside the source folder", repr(reference),
                          "copy the file into the folder and refer to it by a relative path")
    return name


def find_reference(files: FileTree, base: str, reference: str) -> FileRef:
    """Find the file that `base` refers to; SourceError if it does not exist."""
    name = resolve_reference(base, reference)
    found = files.find(name)
    if found is None:
        raise SourceError(base, f"the file {name!r} that it refers to", "no such file",
                          "put it there, or remove the reference")
    return found


def main_file(files: FileTree) -> FileRef:
    """Return the URDF of an object, or its only mesh; SourceError for none or several."""
    for endings in ((URDF,), MESH_SUFFIXES):
        found = [file for file in files.files if suffix(file.name) in endings]
        if len(found) == 1:
            return found[0]
        if found:
            raise SourceError(files.name, "one mesh or one URDF", ", ".join(file.name for file in found),
                              "keep one, or join them in a URDF")
    raise SourceError(files.name, f"a mesh ({', '.join(MESH_SUFFIXES)}) or a URDF", "no such file", "put one there")


def decode_text(file: FileRef) -> str:
    """Read a text file as UTF-8, or as Latin-1 (old exporters) if it is not valid UTF-8."""
    data = file.path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def decode_picture(data: bytes, name: str) -> np.ndarray:
    """Decode an image file to (h, w, 3) uint8 sRGB without transparency; SourceError if unreadable or too large."""
    check_image(data, name, MAX_TEXELS)
    try:
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"))
    except IMAGE_ERRORS as error:
        raise SourceError(name, "an image (PNG, JPEG, BMP, TGA, WebP)", reason(error), "convert it to PNG") from error


class PictureCache:
    """Images of one object by name, decoded once, with at most MAX_TEXELS pixels together."""

    def __init__(self) -> None:
        self._found: dict[str, np.ndarray] = {}
        self._texels = 0

    def read(self, file: FileRef) -> np.ndarray:
        """Read an image file as (h, w, 3) uint8; SourceError if unreadable or too large together with the others."""
        if file.name not in self._found:
            self._found[file.name] = decode_picture(file.path.read_bytes(), file.name)
            self.count(self._found[file.name], file.name)
        return self._found[file.name]

    def count(self, image: np.ndarray, name: str) -> None:
        """Add an image (h, w, 3) to the total; TooLargeError beyond the limit."""
        self._texels += image.size // 3
        if self._texels > MAX_TEXELS:
            raise TooLargeError(name, f"images of at most {MAX_TEXELS / 1e6:.0f} megapixels together", "more", "make them smaller")
