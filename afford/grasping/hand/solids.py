"""Shapes of a hand as triangles: to draw it, to measure it."""

from __future__ import annotations

import numpy as np
import trimesh

from afford.common.errors import SourceError
from afford.grasping.hand.tree import Shape, Tree

SIDES = 24
"""corners around anything round, where nothing else is said"""


def solid(shape: Shape, tree: Tree, sides: int = SIDES) -> trimesh.Trimesh:
    """A shape in the frame of its link, metres; so many corners around anything round."""
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


def farthest(tree: Tree, link: str) -> np.ndarray:
    """(3,) the point of a link's shapes that is farthest from its origin, in its frame; SourceError when it has no shapes."""
    found = next(entry for entry in tree.links if entry.name == link)
    shapes = found.collisions or found.visuals
    if not shapes:
        raise SourceError(f"{tree.name}, link {link!r}", "a shape, or a frame fixed to it, that says where the fingertip is",
                          "neither", "add a fixed joint to a link at the fingertip")
    corners = np.concatenate([solid(shape, tree).vertices for shape in shapes])
    tip: np.ndarray = corners[np.linalg.norm(corners, axis=1).argmax()]
    return tip
