"""What a hand looks like: the triangles of each link, out of its URDF and the meshes that it carries."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from afford.grasping.hand.solids import SIDES, solid
from afford.grasping.hand.tree import Shape, Tree
from afford.grasping.hand.urdf_shapes import SIZES
from afford.surface.meshes.urdf import filename, numbers, origin, parse
from schemas.hand import HandModel


class Skin(NamedTuple):
    """The surface of a link."""

    link: int
    """index into the links of the hand"""
    vertices: np.ndarray
    """(v, 3) float64 m, link frame"""
    faces: np.ndarray
    """(f, 3) int64, counter-clockwise seen from outside"""


def skins(hand: HandModel, kinds: Sequence[str] = ("visual", "collision"), sides: int = SIDES) -> tuple[Skin, ...]:
    """Of the links that have a shape of the first of `kinds` that they have: what they are to look like, or, where nobody says
    what they collide with; so many corners around anything round.
    """
    root = parse(hand.urdf, hand.name)
    tree = Tree(hand.name, (), (), {mesh.file: (mesh.vertices, mesh.faces) for mesh in hand.meshes})
    named = {link.get("name"): next(filter(None, (link.findall(kind) for kind in kinds)), []) for link in root.findall("link")}
    return tuple(_skin(link, named[name], tree, sides) for link, name in enumerate(hand.links) if named.get(name))


def _skin(link: int, elements: list[Xml.Element], tree: Tree, sides: int) -> Skin:
    solids = [solid(_shape(element, tree.name), tree, sides) for element in elements]
    starts = np.cumsum([0] + [len(one.vertices) for one in solids[:-1]])
    faces = [np.asarray(one.faces) + start for one, start in zip(solids, starts, strict=True)]
    return Skin(link, np.concatenate([one.vertices for one in solids]), np.concatenate(faces))


def _shape(element: Xml.Element, name: str) -> Shape:
    """A shape as `afford.grasping.hand.urdf` writes it."""
    kind = next(iter(element.find("geometry") or ()))
    if kind.tag == "mesh":
        return Shape("mesh", (), origin(element, name), filename(kind, name))
    size = np.concatenate([numbers(kind, key, None, name, count) for key, count in SIZES[kind.tag]])
    return Shape(kind.tag, tuple(size.tolist()), origin(element, name))
