"""A hand as URDF with its meshes -> a tree of links. <mimic> couples joints; what moves must have limits and a mass."""

from __future__ import annotations

import xml.etree.ElementTree as Xml

import numpy as np

from afford.common.bounded import TooLargeError
from afford.common.errors import SourceError
from afford.grasping.hand.tree import GREY, Coupling, Joint, Link, Tree, ordered
from afford.grasping.hand.urdf_shapes import Meshes, shapes
from afford.surface.meshes.files import URDF, suffix
from afford.surface.meshes.files import text as file_text
from afford.surface.meshes.urdf import numbers, origin, parse
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
