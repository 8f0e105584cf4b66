"""URDF files: all visual shapes at the places that their joints have at zero, in metres as the format says."""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as Xml
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from trimesh.transformations import euler_matrix

from afford.common.bounded import TooLargeError
from afford.common.errors import SourceError
from afford.surface.meshes.surface import (
    SCHEME,
    PictureCache,
    Surface,
    check_triangles,
    decode_text,
    find_reference,
    join_surfaces,
    plain_surface,
    resolve_reference,
    transform_surface,
)
from schemas.files import FileRef, FileTree

ReadMesh = Callable[[FileTree, FileRef], Surface]
PACKAGE = "package://"
TRIANGLES = {"box": 12, "sphere": 1280, "cylinder": 128}
"""of the shapes that a URDF describes, as they are drawn"""
MAX_DEPTH = 256
"""joints between a link and the base: an arm with a hand has 15; each link costs as many products of matrices"""


def parse(content: str, name: str) -> Xml.Element:
    """The root element; SourceError when it is no URDF."""
    try:
        root = Xml.fromstring(content)
    except Xml.ParseError as error:
        raise SourceError(name, "XML", str(error), "was the file cut short? get it again") from error
    if root.tag != "robot":
        raise SourceError(name, "a <robot> element", f"<{root.tag}>", "give a URDF")
    return root


def mesh_names(root: Xml.Element, name: str, where: str) -> list[str]:
    """References to meshes under `where`, which is visual or collision."""
    return [filename(mesh, name) for mesh in root.findall(f"link/{where}/geometry/mesh")]


def candidates(base: str, reference: str) -> list[str]:
    """Names that a reference may mean: a `package://` is looked for in the folder of the URDF and in those above it."""
    if not reference.startswith(PACKAGE):
        return [resolve_reference(base, reference.removeprefix("file://") if reference.startswith("file://.") else reference)]
    package, _, rest = reference.removeprefix(PACKAGE).partition("/")
    folders, folder = [], posixpath.dirname(base)
    while True:
        folders.append(folder)
        if not folder:
            break
        folder = posixpath.dirname(folder)
    found = [posixpath.normpath(posixpath.join(f, tail)) for f in folders for tail in (f"{package}/{rest}", rest)]
    inside = [name for name in found if not name.startswith("..") and not SCHEME.match(name)]
    if len(inside) < len(found):
        resolve_reference(base, rest)
    return inside


def read_urdf(files: FileTree, file: FileRef, read_mesh: ReadMesh) -> Surface:
    """One surface; the group of a face is the name of its link."""
    root = parse(decode_text(file), file.name)
    poses = _poses(root, file.name)
    colours = {m.get("name", ""): m.find("color") for m in root.findall("material")}
    found: list[Surface] = []
    shapes = _Shapes(files, file, read_mesh, root)
    for link in root.findall("link"):
        name = link.get("name", "")
        for visual in link.findall("visual"):
            shape = shapes.read(visual)
            painted = _painted(shape, visual, colours, file.name)
            found.append(replace(transform_surface(painted, poses[name] @ origin(visual, file.name)), groups=(name,),
                                 group=np.zeros(len(shape.faces), np.int64)))
    if not found:
        raise SourceError(file.name, "a link with a <visual>", "none", "add the visual meshes")
    return join_surfaces(found, "m")


class _Shapes:
    """The shapes of one URDF: each mesh file is read once, and the triangles of all copies are counted before they are made."""

    def __init__(self, files: FileTree, file: FileRef, read_mesh: ReadMesh, root: Xml.Element) -> None:
        kinds = list(root.iterfind("link/visual/geometry/*"))
        self.files, self.file, self.read_mesh = files, file, read_mesh
        self._uses = Counter(kind.get("filename") for kind in kinds)
        self._meshes: dict[str, Surface] = {}
        self._pictures = PictureCache()
        self._triangles = 0
        self._count(sum(TRIANGLES.get(kind.tag, 0) for kind in kinds))

    def read(self, visual: Xml.Element) -> Surface:
        """The geometry of a visual, in its own frame; SourceError for none, or for too many triangles together."""
        geometry = visual.find("geometry")
        kind = next(iter(geometry), None) if geometry is not None else None
        if kind is None:
            raise SourceError(self.file.name, "a shape in <geometry>", "nothing", "name a mesh")
        return self._mesh(kind) if kind.tag == "mesh" else _plain(_solid(kind, self.file.name))

    def _count(self, triangles: int) -> None:
        self._triangles += triangles
        check_triangles(self._triangles, self.file.name)

    def _mesh(self, kind: Xml.Element) -> Surface:
        found = mesh_file(self.files, self.file, kind)
        if found.name not in self._meshes:
            self._meshes[found.name] = self.read_mesh(self.files, found)
            self._count(len(self._meshes[found.name].faces) * self._uses[kind.get("filename")])
            for image in self._meshes[found.name].images:
                self._pictures.count(image, self.file.name)
        return transform_surface(self._meshes[found.name], np.diag([*numbers(kind, "scale", (1.0, 1.0, 1.0), self.file.name), 1.0]))


def _plain(solid: trimesh.Trimesh) -> Surface:
    return plain_surface(solid.vertices, solid.faces)


def mesh_file(files: FileTree, file: FileRef, mesh: Xml.Element) -> FileRef:
    """The file that a <mesh> names; SourceError when it is not there."""
    found = (files.find(name) for name in candidates(file.name, filename(mesh, file.name)))
    present = next((f for f in found if f is not None), None)
    return present or find_reference(files, file.name, filename(mesh, file.name).removeprefix(PACKAGE))


def _solid(kind: Xml.Element, name: str) -> trimesh.Trimesh:
    if kind.tag == "box":
        return trimesh.creation.box(numbers(kind, "size", None, name))
    if kind.tag == "sphere":
        return trimesh.creation.icosphere(3, float(numbers(kind, "radius", None, name, 1)[0]))
    if kind.tag == "cylinder":
        return trimesh.creation.cylinder(numbers(kind, "radius", None, name, 1)[0], numbers(kind, "length", None, name, 1)[0])
    raise SourceError(name, "a mesh, box, sphere or cylinder", f"<{kind.tag}>", "export it as a mesh")


def _painted(shape: Surface, visual: Xml.Element, colours: dict[str, Xml.Element | None], name: str) -> Surface:
    """Shapes of one grey colour take the colour of the URDF; images and colours of the mesh win."""
    material = visual.find("material")
    if material is None or any(image.size > 3 for image in shape.images) or (shape.paint < 0).any() or len(shape.images) > 1:
        return shape
    colour = material.find("color")
    if colour is None:
        colour = colours.get(material.get("name", ""))
    if colour is None:
        return shape
    rgb = np.clip(numbers(colour, "rgba", None, name, 4)[:3], 0, 1)
    return replace(shape, images=tuple(np.round(rgb * 255).astype(np.uint8).reshape(1, 1, 3) for _ in shape.images))


def _poses(root: Xml.Element, name: str) -> dict[str, np.ndarray]:
    """Link -> (4, 4) pose in the base, all joints at zero."""
    joints = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            raise SourceError(name, "parent and child in every joint", f"joint {joint.get('name')!r} without", "correct the URDF")
        joints[child.get("link", "")] = (parent.get("link", ""), origin(joint, name))
    out = {}
    for link in (element.get("name", "") for element in root.findall("link")):
        T, at, seen = np.eye(4), link, set()
        while at in joints:
            if at in seen:
                raise SourceError(name, "joints that form a tree", f"a circle through link {at!r}", "correct the URDF")
            seen.add(at)
            if len(seen) > MAX_DEPTH:
                raise TooLargeError(name, f"at most {MAX_DEPTH} joints between a link and the base", "more", "join links")
            at, step = joints[at]
            T = step @ T
        out[link] = T
    return out


def origin(element: Xml.Element, name: str) -> np.ndarray:
    """(4, 4) of its <origin>, the identity when it has none."""
    place = element.find("origin")
    if place is None:
        return np.eye(4)
    roll, pitch, yaw = numbers(place, "rpy", (0.0, 0.0, 0.0), name)
    T = euler_matrix(roll, pitch, yaw, "sxyz")
    T[:3, 3] = numbers(place, "xyz", (0.0, 0.0, 0.0), name)
    return T


def filename(mesh: Xml.Element, name: str) -> str:
    """What a <mesh> refers to."""
    found = mesh.get("filename", "")
    if not found:
        raise SourceError(name, "filename in every <mesh>", "none", "name the mesh file")
    return found


def numbers(element: Xml.Element, key: str, default: tuple[float, ...] | None, name: str, count: int = 3) -> np.ndarray:
    """`count` numbers of an attribute; SourceError when they are not there."""
    given = element.get(key)
    if given is None and default is not None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in (given or "").split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise SourceError(f"{name}, <{element.tag}> {key}", f"{count} numbers", repr(given), "correct the URDF")
    return values
