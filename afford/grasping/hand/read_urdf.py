"""A hand as URDF with its meshes -> a tree of links. <mimic> couples joints; what moves must have limits and a mass."""

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
from afford.surface.meshes.urdf import mesh_file, numbers, origin, parse
from schemas.files import FileRef, FileTree

FIX = "correct the URDF"
MAX_LINKS = 1000
"""of a hand, or of a robot that carries one: a humanoid with two hands has 100"""
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read(files: FileTree) -> Tree:
    """The only URDF among the files; SourceError names the file and what is wrong with it."""
    found = [file for file in files.files if suffix(file.name) == URDF]
    if len(found) != 1:
        raise SourceError(files.name, "one URDF", ", ".join(f.name for f in found) or "none", "give one hand at a time")
    root = parse(file_text(found[0]), found[0].name)
    tree = _tree(files, found[0], root)
    _check(tree)
    return tree


def _tree(files: FileTree, file: FileRef, root: Xml.Element) -> Tree:
    links = root.findall("link")
    if len(links) > MAX_LINKS:
        raise TooLargeError(file.name, f"a hand of at most {MAX_LINKS} links", str(len(links)), FIX)
    meshes = Meshes(files, file)
    paints = {m.get("name", ""): m for m in root.findall("material")}
    joints = tuple(_joint(joint, file.name) for joint in root.findall("joint"))
    tree = ordered(Tree(file.name, tuple(_link(link, file.name, paints, meshes) for link in links), joints, meshes.found))
    return Tree(files.name, tree.links, tree.joints, meshes.found)


def _link(link: Xml.Element, name: str, paints: dict[str, Xml.Element], meshes: Meshes) -> Link:
    mass, T, inertia = _inertia(link.find("inertial"), f"{name}, link {link.get('name')!r}")
    return Link(link.get("name", ""), mass, T, inertia, shapes(link, "collision", meshes), shapes(link, "visual", meshes),
                _rgb(link, name, paints))


def _inertia(inertial: Xml.Element | None, where: str) -> tuple[float, np.ndarray, np.ndarray]:
    if inertial is None:
        return 0.0, np.eye(4), np.zeros((3, 3))
    mass, tensor = inertial.find("mass"), inertial.find("inertia")
    if mass is None or tensor is None:
        raise SourceError(where, "<mass> and <inertia> in <inertial>", "one of them alone", FIX)
    xx, xy, xz, yy, yz, zz = (_number(tensor, key, where) for key in INERTIA)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return _number(mass, "value", where), origin(inertial, where), matrix


def _rgb(link: Xml.Element, name: str, paints: dict[str, Xml.Element]) -> tuple[float, float, float]:
    """The colour of the first visual, by itself or by the name of a material; grey where nobody says one."""
    material = link.find("visual/material")
    colour = None if material is None else material.find("color")
    if material is not None and colour is None:
        colour = paints.get(material.get("name", ""), material).find("color")
    if colour is None:
        return GREY
    r, g, b = np.clip(numbers(colour, "rgba", None, name, 4)[:3], 0, 1)
    return float(r), float(g), float(b)


def _joint(joint: Xml.Element, file: str) -> Joint:
    name, kind = joint.get("name", ""), joint.get("type", "")
    where = f"{file}, joint {name!r}"
    parent, child = joint.find("parent"), joint.find("child")
    if parent is None or child is None:
        raise SourceError(where, "a parent and a child", "one of them alone", FIX)
    hangs = (name, kind, parent.get("link", ""), child.get("link", ""), origin(joint, where))
    if kind == "fixed":
        return Joint(*hangs)
    if kind not in ("revolute", "prismatic"):
        raise SourceError(where, "a joint that is revolute, prismatic or fixed", repr(kind), "give it limits and make it revolute")
    lower, upper, effort, velocity = _limits(joint, where)
    damping, friction = _dynamics(joint, where)
    return Joint(*hangs, _axis(joint, where), lower, upper, effort, velocity, damping, friction, _coupling(joint, where))


def _limits(joint: Xml.Element, where: str) -> tuple[float, float, float, float]:
    limit = joint.find("limit")
    if limit is None:
        raise SourceError(where, "a <limit> with lower, upper, effort and velocity", "none", "add it")
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
    """Unit length; along x where the file does not say, as URDF has it."""
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
    """What is needed to move the hand."""
    mass = {link.name: link.mass_kg for link in tree.links}
    for joint in tree.joints:
        if joint.kind != "fixed" and mass[joint.child] <= 0:
            raise SourceError(f"{tree.name}, link {joint.child!r}", "a mass above zero, because it moves",
                              f"{mass[joint.child]} kg", "add an <inertial>")


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
            surface = transform_surface(self._surface(file), np.diag([*scale, 1.0]))
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
    return tuple(_read_shape(element, meshes) for element in link.findall(where))


def _read_shape(element: Xml.Element, meshes: Meshes) -> Shape:
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
