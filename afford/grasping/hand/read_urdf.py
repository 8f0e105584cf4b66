"""Read a robot hand from a URDF and its meshes into a kinematic tree.

<mimic> couples joints. Joints that move need limits, and their links a mass.
"""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as Xml
from collections import Counter

import numpy as np

from afford.common.bounded import TooLargeError
from afford.common.errors import SourceError
from afford.grasping.hand.tree import GREY, Coupling, Joint, Link, Shape, Tree, ordered
from afford.surface.meshes.read import read_mesh
from afford.surface.meshes.surface import URDF, Surface, check_triangles, suffix, transform_surface
from afford.surface.meshes.surface import decode_text as file_text
from afford.surface.meshes.urdf import (
    SIZES,
    colour_of,
    dimensions,
    joint_links,
    mesh_file,
    named_colours,
    numbers,
    origin,
    parse,
    shape_element,
)
from schemas.files import FileRef, FileTree

FIX = "correct the URDF"
MAX_LINKS = 1000
"""of a hand, or of a robot that carries one: a humanoid with two hands has 100"""
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read(files: FileTree) -> Tree:
    """Read the only URDF among the files; SourceError names the file and its fault."""
    found = [file for file in files.files if suffix(file.name) == URDF]
    if len(found) != 1:
        raise SourceError(files.name, "one URDF", ", ".join(f.name for f in found) or "no URDF", "keep one hand in a folder")
    root = parse(file_text(found[0]), found[0].name)
    tree = _tree(files, found[0], root)
    _check(tree)
    return tree


def _tree(files: FileTree, file: FileRef, root: Xml.Element) -> Tree:
    links = root.findall("link")
    if len(links) > MAX_LINKS:
        raise TooLargeError(file.name, f"a hand of at most {MAX_LINKS} links", str(len(links)), FIX)
    meshes = Meshes(files, file)
    colours = named_colours(root)
    joints = tuple(_joint(joint, file.name) for joint in root.findall("joint"))
    tree = ordered(Tree(file.name, tuple(_link(link, file.name, colours, meshes) for link in links), joints, meshes.found))
    return Tree(files.name, tree.links, tree.joints, meshes.found)


def _link(link: Xml.Element, name: str, colours: dict[str, Xml.Element | None], meshes: Meshes) -> Link:
    mass, T, inertia = _inertia(link.find("inertial"), f"{name}, link {link.get('name')!r}")
    found = colour_of(link.find("visual/material"), colours, name)
    rgb = GREY if found is None else (float(found[0]), float(found[1]), float(found[2]))
    return Link(link.get("name", ""), mass, T, inertia, shapes(link, "collision", meshes), shapes(link, "visual", meshes), rgb)


def _inertia(inertial: Xml.Element | None, where: str) -> tuple[float, np.ndarray, np.ndarray]:
    if inertial is None:
        return 0.0, np.eye(4), np.zeros((3, 3))
    mass, tensor = inertial.find("mass"), inertial.find("inertia")
    if mass is None or tensor is None:
        raise SourceError(where, "<mass> and <inertia> in <inertial>", "one of them", FIX)
    xx, xy, xz, yy, yz, zz = (_number(tensor, key, where) for key in INERTIA)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return _number(mass, "value", where), origin(inertial, where), matrix


def _joint(joint: Xml.Element, file: str) -> Joint:
    name, kind = joint.get("name", ""), joint.get("type", "")
    where = f"{file}, joint {name!r}"
    connection = (name, kind, *joint_links(joint, file), origin(joint, where))
    if kind == "fixed":
        return Joint(*connection)
    if kind not in ("revolute", "prismatic"):
        raise SourceError(where, "a joint that is revolute, prismatic or fixed", repr(kind), "make the joint revolute")
    lower, upper, effort, velocity = _limits(joint, where)
    damping, friction = _dynamics(joint, where)
    return Joint(*connection, _axis(joint, where), lower, upper, effort, velocity, damping, friction,
                 _coupling(joint, where))  # fmt: skip


def _limits(joint: Xml.Element, where: str) -> tuple[float, float, float, float]:
    limit = joint.find("limit")
    if limit is None:
        raise SourceError(where, "a <limit> with lower, upper, effort and velocity", "no <limit>", "add it")
    lower, upper, effort, velocity = (_number(limit, key, where) for key in ("lower", "upper", "effort", "velocity"))
    if lower >= upper or effort <= 0 or velocity <= 0:
        raise SourceError(where, "lower < upper, and effort and velocity above zero",
                          f"lower {lower}, upper {upper}, effort {effort}, velocity {velocity}", FIX)
    return lower, upper, effort, velocity


def _dynamics(joint: Xml.Element, where: str) -> tuple[float, float]:
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return 0.0, 0.0
    return _number(dynamics, "damping", where, 0.0), _number(dynamics, "friction", where, 0.0)


def _axis(joint: Xml.Element, where: str) -> tuple[float, float, float]:
    """Read the unit axis of a joint; without <axis> it is x, as the URDF standard says."""
    element = joint.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if element is None else numbers(element, "xyz", None, where)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise SourceError(where, "an axis with a direction", "0 0 0", FIX)
    x, y, z = axis / length
    return float(x), float(y), float(z)


def _coupling(joint: Xml.Element, where: str) -> Coupling | None:
    mimic = joint.find("mimic")
    if mimic is None:
        return None
    return Coupling(mimic.get("joint", ""), _number(mimic, "multiplier", where, 1.0), _number(mimic, "offset", where, 0.0))


def _number(element: Xml.Element, key: str, where: str, default: float | None = None) -> float:
    return float(numbers(element, key, None if default is None else (default,), where, 1)[0])


def _check(tree: Tree) -> None:
    """Check that every link that moves has a mass."""
    mass = {link.name: link.mass_kg for link in tree.links}
    for joint in tree.joints:
        if joint.kind != "fixed" and mass[joint.child] <= 0:
            raise SourceError(f"{tree.name}, link {joint.child!r}", "a mass above zero, because the link moves",
                              f"{mass[joint.child]} kg", "add an <inertial>")


class Meshes:
    """Meshes that a URDF names, one for each file and scale, under the names that they get in the tree."""

    def __init__(self, files: FileTree, urdf: FileRef) -> None:
        self.files, self.urdf = files, urdf
        self.found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._surfaces: dict[str, Surface] = {}
        self._triangles = 0
        self._taken: Counter[str] = Counter()
        """dotted prefix -> how many names begin with it"""
        self._names: dict[tuple[str, tuple[float, ...]], str] = {}

    def name(self, mesh: Xml.Element) -> str:
        """Read a mesh if it is new and return its name; SourceError when the file is missing or has no triangles."""
        file = mesh_file(self.files, self.urdf, mesh)
        scale = tuple(map(float, numbers(mesh, "scale", (1.0, 1.0, 1.0), self.urdf.name)))
        if (file.name, scale) not in self._names:
            surface = transform_surface(self._surface(file), np.diag([*scale, 1.0]))
            if not len(surface.faces):
                raise SourceError(file.name, "triangles", "an empty mesh", "export the mesh again")
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
    """Read all shapes of a link under `where`, which is collision or visual."""
    return tuple(_read_shape(element, meshes) for element in link.findall(where))


def _read_shape(element: Xml.Element, meshes: Meshes) -> Shape:
    name = meshes.urdf.name
    kind, T = shape_element(element, name, (*SIZES, "mesh")), origin(element, name)
    if kind.tag == "mesh":
        return Shape("mesh", (), T, meshes.name(kind))
    size = dimensions(kind, name)
    if (size <= 0).any():
        raise SourceError(f"{name}, <{kind.tag}>", "sizes above zero", " ".join(map(str, size)), "correct the URDF")
    return Shape(kind.tag, tuple(map(float, size)), T)
