"""Triangle meshes of the links of a hand, for rendering and measuring."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh

from afford.common.errors import SourceError
from afford.grasping.hand.tree import Shape, Tree
from afford.surface.meshes.urdf import dimensions, filename, origin, parse
from schemas.hand import HandModel

SIDES = 24
"""default number of corners around a round shape"""


def shape_mesh(shape: Shape, tree: Tree, sides: int = SIDES) -> trimesh.Trimesh:
    """Triangulate a shape in the frame of its link, metres, with `sides` corners around round shapes."""
    return _solid(shape, tree, sides).apply_transform(shape.T_link_shape)


def _solid(shape: Shape, tree: Tree, sides: int) -> trimesh.Trimesh:
    if shape.kind == "mesh":
        vertices, faces = tree.meshes[shape.mesh]
        return trimesh.Trimesh(vertices, faces, process=False)
    if shape.kind == "box":
        return trimesh.creation.box(shape.size_m)
    if shape.kind == "sphere":
        return trimesh.creation.icosphere(2, shape.size_m[0])
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(shape.size_m[0], shape.size_m[1], sides)
    capsule = trimesh.creation.capsule(shape.size_m[1], shape.size_m[0], count=(sides, sides))
    return capsule.apply_translation(-capsule.bounds.mean(axis=0))


def farthest_point(tree: Tree, link: str) -> np.ndarray:
    """Return the (3,) point of a link's shapes that is farthest from the link's origin, in the link frame.

    SourceError when the link has no shapes.
    """
    found = next(entry for entry in tree.links if entry.name == link)
    shapes = found.collisions or found.visuals
    if not shapes:
        raise SourceError(f"{tree.name}, link {link!r}", "a shape, or a frame fixed to it, that says where the fingertip is",
                          "neither", "add a fixed joint to a link at the fingertip")
    corners = np.concatenate([shape_mesh(shape, tree).vertices for shape in shapes])
    tip: np.ndarray = corners[np.linalg.norm(corners, axis=1).argmax()]
    return tip


class LinkMesh(NamedTuple):
    """Surface of one link."""

    link: int
    """index into the links of the hand"""
    vertices: np.ndarray
    """(v, 3) float64 m, link frame"""
    faces: np.ndarray
    """(f, 3) int64, counter-clockwise seen from outside"""


def link_meshes(hand: HandModel, kinds: Sequence[str] = ("visual", "collision"), sides: int = SIDES) -> tuple[LinkMesh, ...]:
    """Triangulate the links of a hand from its URDF and meshes.

    Each link uses the first of `kinds` for which it has shapes; links without shapes are left out. Round shapes have `sides`
    corners.
    """
    root = parse(hand.urdf, hand.name)
    tree = Tree(hand.name, (), (), {mesh.file: (mesh.vertices, mesh.faces) for mesh in hand.meshes})
    named = {link.get("name"): next(filter(None, (link.findall(kind) for kind in kinds)), []) for link in root.findall("link")}
    return tuple(_skin(link, named[name], tree, sides) for link, name in enumerate(hand.links) if named.get(name))


def _skin(link: int, elements: list[Xml.Element], tree: Tree, sides: int) -> LinkMesh:
    solids = [shape_mesh(_shape(element, tree.name), tree, sides) for element in elements]
    starts = np.cumsum([0] + [len(one.vertices) for one in solids[:-1]])
    faces = [np.asarray(one.faces) + start for one, start in zip(solids, starts, strict=True)]
    return LinkMesh(link, np.concatenate([one.vertices for one in solids]), np.concatenate(faces))


def _shape(element: Xml.Element, name: str) -> Shape:
    """Read a shape from the XML that `afford.grasping.hand.export` writes."""
    kind = next(iter(element.find("geometry") or ()))
    if kind.tag == "mesh":
        return Shape("mesh", (), origin(element, name), filename(kind, name))
    return Shape(kind.tag, tuple(dimensions(kind, name).tolist()), origin(element, name))
