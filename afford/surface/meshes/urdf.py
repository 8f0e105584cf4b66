"""Read URDF files: their XML elements, and the visual surface of an object with all joints at zero, in metres.

The reader of robot hands (`afford/grasping/hand/read_urdf.py`) shares the functions for elements. The parser reads no other file:
external entities are refused.
"""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as Xml
from collections import Counter
from collections.abc import Callable, Sequence
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
SIZES = {"box": (("size", 3),), "sphere": (("radius", 1),), "cylinder": (("radius", 1), ("length", 1)),
         "capsule": (("radius", 1), ("length", 1))}  # fmt: skip
"""shape -> its attributes and the count of numbers in each; the standard has no capsule, but engines read it"""
TRIANGLES = {"mesh": 0, "box": 12, "sphere": 1280, "cylinder": 128}
"""shapes of an object -> triangles of each; those of a mesh are counted when its file is read"""
MAX_DEPTH = 256
"""joints between a link and the base, at most: an arm with a hand has 15; each link costs as many matrix products"""


def parse(content: str, name: str) -> Xml.Element:
    """Parse the XML of a URDF and return its root element; SourceError for other content."""
    try:
        root = Xml.fromstring(content)
    except Xml.ParseError as error:
        raise SourceError(name, "XML", str(error), "was the file cut short? get it again") from error
    if root.tag != "robot":
        raise SourceError(name, "a <robot> element", f"<{root.tag}>", "give a URDF")
    return root


def mesh_names(root: Xml.Element, name: str, where: str) -> list[str]:
    """List the references to meshes under `where`, which is visual or collision."""
    return [filename(mesh, name) for mesh in root.findall(f"link/{where}/geometry/mesh")]


def candidates(base: str, reference: str) -> list[str]:
    """List the file names that a reference may mean.

    A `package://` is looked up in the folder of the URDF and in all folders above it.
    """
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
    """Read all visual shapes as one surface; the group of a face is the name of its link."""
    root = parse(decode_text(file), file.name)
    poses = _poses(root, file.name)
    colours = named_colours(root)
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
        raise SourceError(file.name, "a link with a <visual>", "links without visuals", "add the visual meshes")
    return join_surfaces(found, "m")


class _Shapes:
    """Shapes of one URDF. Each mesh file is read once; the triangles of all copies are counted before they are allocated."""

    def __init__(self, files: FileTree, file: FileRef, read_mesh: ReadMesh, root: Xml.Element) -> None:
        kinds = list(root.iterfind("link/visual/geometry/*"))
        self.files, self.file, self.read_mesh = files, file, read_mesh
        self._uses = Counter(kind.get("filename") for kind in kinds)
        self._meshes: dict[str, Surface] = {}
        self._pictures = PictureCache()
        self._triangles = 0
        self._count(sum(TRIANGLES.get(kind.tag, 0) for kind in kinds))

    def read(self, visual: Xml.Element) -> Surface:
        """Read the geometry of a visual in its own frame; SourceError for an unknown shape or too many triangles."""
        kind = shape_element(visual, self.file.name, tuple(TRIANGLES))
        return self._mesh(kind) if kind.tag == "mesh" else _solid(kind, self.file.name)

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


def mesh_file(files: FileTree, file: FileRef, mesh: Xml.Element) -> FileRef:
    """Find the file that a <mesh> names; SourceError when it does not exist."""
    found = (files.find(name) for name in candidates(file.name, filename(mesh, file.name)))
    present = next((f for f in found if f is not None), None)
    return present or find_reference(files, file.name, filename(mesh, file.name).removeprefix(PACKAGE))


def _solid(kind: Xml.Element, name: str) -> Surface:
    sizes = dimensions(kind, name)
    made = {"box": lambda: trimesh.creation.box(sizes), "sphere": lambda: trimesh.creation.icosphere(3, float(sizes[0])),
            "cylinder": lambda: trimesh.creation.cylinder(*sizes)}[kind.tag]()  # fmt: skip
    return plain_surface(made.vertices, made.faces)


def _painted(shape: Surface, visual: Xml.Element, colours: dict[str, Xml.Element | None], name: str) -> Surface:
    """Paint a shape of one grey colour with the colour of the URDF; images and colours of the mesh take precedence."""
    if any(image.size > 3 for image in shape.images) or (shape.paint < 0).any() or len(shape.images) > 1:
        return shape
    rgb = colour_of(visual.find("material"), colours, name)
    if rgb is None:
        return shape
    return replace(shape, images=tuple(np.round(rgb * 255).astype(np.uint8).reshape(1, 1, 3) for _ in shape.images))


def _poses(root: Xml.Element, name: str) -> dict[str, np.ndarray]:
    """Compute the pose of every link in the base frame, (4, 4), with all joints at zero."""
    joints = {}
    for joint in root.findall("joint"):
        parent, child = joint_links(joint, name)
        joints[child] = (parent, origin(joint, name))
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
    """Read an <origin> as a (4, 4) pose; the identity when there is none."""
    place = element.find("origin")
    if place is None:
        return np.eye(4)
    roll, pitch, yaw = numbers(place, "rpy", (0.0, 0.0, 0.0), name)
    T = euler_matrix(roll, pitch, yaw, "sxyz")
    T[:3, 3] = numbers(place, "xyz", (0.0, 0.0, 0.0), name)
    return T


def shape_element(element: Xml.Element, name: str, kinds: Sequence[str]) -> Xml.Element:
    """Return the shape in the <geometry> of a <visual> or <collision>; SourceError when it is none of `kinds`."""
    geometry = element.find("geometry")
    kind = next(iter(geometry), None) if geometry is not None else None
    if kind is None or kind.tag not in kinds:
        got = "nothing" if kind is None else f"<{kind.tag}>"
        raise SourceError(name, f"one of {', '.join(kinds)} in <geometry>", got, "export the shape as a mesh")
    return kind


def dimensions(shape: Xml.Element, name: str) -> np.ndarray:
    """Read the numbers of a box (3 sides), sphere (radius), cylinder or capsule (radius, length), in metres."""
    return np.concatenate([numbers(shape, key, None, name, count) for key, count in SIZES[shape.tag]])


def named_colours(root: Xml.Element) -> dict[str, Xml.Element | None]:
    """Map the names of the materials of a robot to their <color>."""
    return {material.get("name", ""): material.find("color") for material in root.findall("material")}


def colour_of(material: Xml.Element | None, named: dict[str, Xml.Element | None], name: str) -> np.ndarray | None:
    """Return the (3,) RGB of a material, 0..1, its own or that of its name; None when neither has a colour."""
    if material is None:
        return None
    colour = material.find("color")
    if colour is None:
        colour = named.get(material.get("name", ""))
    return None if colour is None else np.clip(numbers(colour, "rgba", None, name, 4)[:3], 0, 1)


def joint_links(joint: Xml.Element, name: str) -> tuple[str, str]:
    """Return the names of the parent and the child link of a joint; SourceError when either is missing."""
    parent, child = joint.find("parent"), joint.find("child")
    if parent is None or child is None:
        missing = "<parent>" if parent is None else "<child>"
        where = f"{name}, joint {joint.get('name', '')!r}"
        raise SourceError(where, "a <parent> and a <child>", f"no {missing}", "correct the URDF")
    return parent.get("link", ""), child.get("link", "")


def filename(mesh: Xml.Element, name: str) -> str:
    """Return the reference of a <mesh>."""
    found = mesh.get("filename", "")
    if not found:
        raise SourceError(name, "a filename in every <mesh>", "an empty one", "name the mesh file")
    return found


def numbers(element: Xml.Element, key: str, default: tuple[float, ...] | None, name: str, count: int = 3) -> np.ndarray:
    """Read `count` finite numbers of an attribute; SourceError when they are missing or malformed."""
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
