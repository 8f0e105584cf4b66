"""The shapes of a link in a URDF, and the meshes that they name: read once, in metres."""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as Xml
from collections import Counter

import numpy as np

from afford.common.errors import SourceError
from afford.grasping.hand.tree import Shape
from afford.surface.meshes.read import read_mesh
from afford.surface.meshes.surface import Surface, check_triangles, moved
from afford.surface.meshes.urdf import mesh_file, numbers, origin
from schemas.files import FileRef, FileTree

SIZES = {"box": (("size", 3),), "sphere": (("radius", 1),), "cylinder": (("radius", 1), ("length", 1)),
         "capsule": (("radius", 1), ("length", 1))}  # fmt: skip
"""shape -> its attributes, and how many numbers each has; capsule is not of the standard, but engines read it"""


class Meshes:
    """Meshes of a URDF by the name that they get here: one for each file and scale."""

    def __init__(self, files: FileTree, urdf: FileRef) -> None:
        self.files, self.urdf = files, urdf
        self.found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._surfaces: dict[str, Surface] = {}
        self._triangles = 0
        self._taken: Counter[str] = Counter()
        """how many names begin with these words and a dot"""
        self._names: dict[tuple[str, tuple[float, ...]], str] = {}

    def name(self, mesh: Xml.Element) -> str:
        """Read it, when it is new; SourceError when the file is not there or has no triangles."""
        file = mesh_file(self.files, self.urdf, mesh)
        scale = tuple(map(float, numbers(mesh, "scale", (1.0, 1.0, 1.0), self.urdf.name)))
        if (file.name, scale) not in self._names:
            surface = moved(self._surface(file), np.diag([*scale, 1.0]))
            if not len(surface.faces):
                raise SourceError(file.name, "triangles", "none", "export the mesh again")
            self._triangles += len(surface.faces)
            check_triangles(self._triangles, self.urdf.name)
            name = self._free(posixpath.splitext(file.name)[0].removeprefix("meshes/").replace("/", "_"))
            self._names[file.name, scale] = name
            self.found[name] = (surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
        return self._names[file.name, scale]

    def _surface(self, file: FileRef) -> Surface:
        if file.name not in self._surfaces:
            self._surfaces[file.name] = read_mesh(self.files, file)
        return self._surfaces[file.name]

    def _free(self, stem: str) -> str:
        name = f"{stem}.{self._taken[stem]}" if self._taken[stem] else stem
        words = f"{name}.obj".split(".")
        self._taken.update(".".join(words[:k]) for k in range(1, len(words)))
        return f"meshes/{name}.obj"


def shapes(link: Xml.Element, where: str, meshes: Meshes) -> tuple[Shape, ...]:
    """All shapes of a link under `where`, which is collision or visual."""
    return tuple(_shape(element, meshes) for element in link.findall(where))


def _shape(element: Xml.Element, meshes: Meshes) -> Shape:
    name, geometry = meshes.urdf.name, element.find("geometry")
    kind = next(iter(geometry), None) if geometry is not None else None
    if kind is None or kind.tag not in (*SIZES, "mesh"):
        raise SourceError(name, "a box, sphere, cylinder, capsule or mesh in <geometry>",
                          "nothing" if kind is None else f"<{kind.tag}>", "correct the URDF")
    T = origin(element, name)
    if kind.tag == "mesh":
        return Shape("mesh", (), T, meshes.name(kind))
    size = np.concatenate([numbers(kind, key, None, name, count) for key, count in SIZES[kind.tag]])
    if (size <= 0).any():
        raise SourceError(f"{name}, <{kind.tag}>", "sizes above zero", " ".join(map(str, size)), "correct the URDF")
    return Shape(kind.tag, tuple(map(float, size)), T)
