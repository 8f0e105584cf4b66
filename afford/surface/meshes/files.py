"""The files of one object: what refers to what, without ever leaving the folder of the source."""

from __future__ import annotations

import io
import posixpath
import re

import numpy as np
from PIL import Image

from afford.common.bounded import IMAGE_ERRORS, TooLargeError, check_image, reason
from afford.common.errors import SourceError
from schemas.files import FileRef, FileTree

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")
URDF = ".urdf"
LABELS = ".parts.json"
MAX_TEXELS = 1 << 27
"""pixels of all images of one object: two of 8192 x 8192, the largest that renderers take; 400 MB as RGB"""
SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*:")


def suffix(name: str) -> str:
    """Ending of a file name in small letters, with its dot."""
    return posixpath.splitext(name)[1].lower()


def resolve_reference(base: str, reference: str) -> str:
    """Root-relative name of what the file `base` calls `reference`; SourceError when that is outside the source."""
    path = reference.strip().strip('"').replace("\\", "/")
    name = posixpath.normpath(posixpath.join(posixpath.dirname(base), path))
    if SCHEME.match(path) or path.startswith("/") or name == ".." or name.startswith("../"):
        raise SourceError(base, "references to files inside the source folder", repr(reference),
                          "copy the file into the folder and refer to it by a relative path")
    return name


def find_reference(files: FileTree, base: str, reference: str) -> FileRef:
    """The file of the tree that `base` calls `reference`; SourceError when it is not there."""
    name = resolve_reference(base, reference)
    found = files.find(name)
    if found is None:
        raise SourceError(base, f"the file {name!r} that it refers to", "no such file",
                          "put it there, or remove the reference")
    return found


def main_file(files: FileTree) -> FileRef:
    """The URDF of an object, or else its only mesh; SourceError for none or several."""
    for endings in ((URDF,), MESH_SUFFIXES):
        found = [file for file in files.files if suffix(file.name) in endings]
        if len(found) == 1:
            return found[0]
        if found:
            raise SourceError(files.name, "one mesh or one URDF", ", ".join(file.name for file in found),
                              "keep one, or join them in a URDF")
    raise SourceError(files.name, f"a mesh ({', '.join(MESH_SUFFIXES)}) or a URDF", "none", "put one there")


def decode_text(file: FileRef) -> str:
    """The text of a file; bytes that are not UTF-8 are read as Latin-1, which old exporters wrote."""
    data = file.path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def decode_picture(data: bytes, name: str) -> np.ndarray:
    """(h, w, 3) uint8 sRGB of an image file, transparency left out; SourceError when it cannot be read or is too large."""
    check_image(data, name, MAX_TEXELS)
    try:
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"))
    except IMAGE_ERRORS as error:
        raise SourceError(name, "an image (PNG, JPEG, BMP, TGA, WebP)", reason(error), "convert it to PNG") from error


class PictureCache:
    """The images of one object by name: each is decoded once, and together they have at most MAX_TEXELS pixels."""

    def __init__(self) -> None:
        self._found: dict[str, np.ndarray] = {}
        self._texels = 0

    def read(self, file: FileRef) -> np.ndarray:
        """(h, w, 3) uint8 of an image file; SourceError when it cannot be read, or all are too large together."""
        if file.name not in self._found:
            self._found[file.name] = decode_picture(file.path.read_bytes(), file.name)
            self.count(self._found[file.name], file.name)
        return self._found[file.name]

    def count(self, image: np.ndarray, name: str) -> None:
        """Add an image (h, w, 3) to the total; TooLargeError when that is beyond the limit."""
        self._texels += image.size // 3
        if self._texels > MAX_TEXELS:
            raise TooLargeError(name, f"images of at most {MAX_TEXELS / 1e6:.0f} megapixels together", "more", "make them smaller")
