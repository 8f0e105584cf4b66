"""Kinematic tree of a robot hand: links with their shapes, and joints. The readers of MJCF and URDF both return it.

Units are metres, kilograms and radians; poses are (4, 4).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from afford.common.errors import SourceError

GREY = (0.93, 0.93, 0.93)


@dataclass(frozen=True, eq=False)
class Shape:
    """Solid fixed to a link."""

    kind: str
    """box, sphere, cylinder, capsule or mesh"""
    size_m: tuple[float, ...]
    """box: sides; sphere: radius; cylinder, capsule: radius and length along z without a capsule's caps; mesh: ()"""
    T_link_shape: np.ndarray
    mesh: str = ""
    """key into `Tree.meshes`"""


@dataclass(frozen=True, eq=False)
class Link:
    """Rigid body."""

    name: str
    mass_kg: float = 0.0
    T_link_inertia: np.ndarray = field(default_factory=lambda: np.eye(4))
    inertia_kgm2: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    collisions: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()
    rgb: tuple[float, float, float] = GREY
    """sRGB, 0..1"""


@dataclass(frozen=True)
class Coupling:
    """Relation of a joint to its driver: q = ratio * q_driver + offset."""

    driver: str
    ratio: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """Connection of a link to its parent."""

    name: str
    kind: str
    """revolute, prismatic or fixed"""
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    coupling: Coupling | None = None


@dataclass(frozen=True, eq=False)
class Tree:
    """Links and joints, root first; joint k carries link k + 1."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    meshes: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """file name in a URDF -> (v, 3) float32 vertices in metres, (t, 3) int32 faces"""
    tips: Mapping[str, np.ndarray] = field(default_factory=dict)
    """link -> (3,) fingertip in its frame, for sources that name it"""
    contacts: tuple[tuple[str, str], ...] | None = None
    """pairs of links that may touch each other; None when the source does not list them"""

    def path(self, link: str) -> list[Joint]:
        """Return the joints from the root to a link, root first."""
        carrier = {joint.child: joint for joint in self.joints}
        out: list[Joint] = []
        while link in carrier:
            out.append(carrier[link])
            link = carrier[link].parent
        return out[::-1]

    def leaves(self) -> list[str]:
        """Return the names of the links that have no children."""
        parents = {joint.parent for joint in self.joints}
        return [link.name for link in self.links if link.name not in parents]


def ordered(tree: Tree) -> Tree:
    """Sort links and joints so that every parent comes before its children.

    Siblings keep their order. SourceError when the joints do not form one tree.
    """
    links = _by_name([link.name for link in tree.links], "link", tree.name)
    _by_name([joint.name for joint in tree.joints], "joint", tree.name)
    carried = _by_name([joint.child for joint in tree.joints], "carried link", tree.name)
    unknown = [name for joint in tree.joints for name in (joint.parent, joint.child) if name not in links]
    if unknown:
        raise SourceError(tree.name, "joints between its own links", f"a joint of {unknown[0]!r}",
                          "add the link or correct its name")
    roots = [name for name in links if name not in carried]
    if len(roots) > 1 or not links:
        raise SourceError(tree.name, "one root link", " and ".join(roots) or "no links", "join all links below one")
    joints = _below(tree, roots[0]) if roots else []
    if len(joints) != len(links) - 1:
        lost = next(name for name in links if name not in {*roots, *(joint.child for joint in joints)})
        raise SourceError(tree.name, "joints that form a tree", f"a circle through link {lost!r}", "correct the joints")
    names = [roots[0], *(joint.child for joint in joints)]
    return replace(tree, links=tuple(tree.links[links[name]] for name in names), joints=tuple(joints))


def subtree(tree: Tree, root: str) -> Tree:
    """Return the tree below `root`, with the meshes that it needs."""
    joints = _below(tree, root)
    kept = {root, *(joint.child for joint in joints)}
    links = tuple(link for link in tree.links if link.name in kept)
    used = {shape.mesh for link in links for shape in (*link.collisions, *link.visuals)}
    pairs = None if tree.contacts is None else tuple(pair for pair in tree.contacts if kept.issuperset(pair))
    return replace(tree, links=links, joints=tuple(joints), contacts=pairs,
                   meshes={name: mesh for name, mesh in tree.meshes.items() if name in used},
                   tips={name: tip for name, tip in tree.tips.items() if name in kept})


def _below(tree: Tree, root: str) -> list[Joint]:
    """List the joints below a link, depth first."""
    carried: dict[str, list[Joint]] = {}
    for joint in reversed(tree.joints):
        carried.setdefault(joint.parent, []).append(joint)
    out: list[Joint] = []
    waiting = [*carried.get(root, ())]
    while waiting and len(out) <= len(tree.joints):
        out.append(waiting.pop())
        waiting.extend(carried.get(out[-1].child, ()))
    return out


def _by_name(names: Iterable[str], what: str, where: str) -> dict[str, int]:
    found: dict[str, int] = {}
    for number, name in enumerate(names):
        if name in found or not name:
            raise SourceError(where, f"every {what} once, with a name", f"{name!r} twice" if name else "one without", "rename it")
        found[name] = number
    return found
