"""Build a HandModel from a kinematic tree: cut it at the root, mount it on a gantry, find fingers, write its URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from afford.common.errors import SourceError
from afford.grasping.hand import export
from afford.grasping.hand.fingers import Finger, below_link, common_link, find_fingers, grip_axes, hand_side
from afford.grasping.hand.tree import Coupling, Joint, Link, Tree, ordered, subtree
from schemas.hand import HandFingers, HandJoints, HandMesh, HandModel


@dataclass(frozen=True)
class HandOptions:
    """Options of the hand that is built."""

    root: str = ""
    """link at which the hand starts; '' = the palm"""
    gantry: Gantry | None = None
    """None: the root is free, or the engine fixes it"""
    capsules: bool = True
    """False: write a cylinder and two spheres for each capsule"""
    fingers: Sequence[str] = ()
    """finger=last link, for links whose names do not say it"""


def build_hand(tree: Tree, options: HandOptions) -> HandModel:
    """Build the hand; SourceError when the tree lacks what a hand needs."""
    found = find_fingers(tree, options.fingers)
    palm = common_link(tree, [finger.tip_link for finger in found])
    hand = _cut(tree, options.root or palm, palm)
    hand = hand if options.gantry is None else mount_on_gantry(hand, options.gantry)
    hand = hand if options.capsules else _split(hand)
    at = {link.name: number for number, link in enumerate(hand.links)}
    joints = _joints(hand, at, palm)
    table = _fingers(found, at)
    R = grip_axes(joints, table, at[palm])
    return HandModel(
        name=hand.name, side=hand_side(joints, table, at[palm], R), urdf=export.urdf_text(hand), links=tuple(at),
        mass_kg=np.array([link.mass_kg for link in hand.links]),
        rgb=np.round(np.array([link.rgb for link in hand.links]) * 255).astype(np.uint8),
        joints=joints, fingers=table, palm=at[palm], R_palm_grip=R, contacts=_contacts(hand, at, found),
        meshes=tuple(HandMesh(file, vertices, faces) for file, (vertices, faces) in sorted(hand.meshes.items())),
    )  # fmt: skip


def _cut(tree: Tree, root: str, palm: str) -> Tree:
    above = [tree.links[0].name, *(joint.child for joint in tree.path(palm))]
    if root not in above:
        raise SourceError(f"{tree.name}, root", f"a link that carries the palm: {', '.join(above)}", repr(root),
                          "choose one of them")
    out = subtree(tree, root)
    kept = {joint.name for joint in out.joints}
    lost = [joint for joint in out.joints if joint.coupling is not None and joint.coupling.driver not in kept]
    if lost:
        raise SourceError(f"{tree.name}, joint {lost[0].name!r}", f"to follow a joint beyond the root {root!r}",
                          f"{lost[0].coupling}", "choose a root above that joint")
    return out


def _split(tree: Tree) -> Tree:
    return replace(tree, links=tuple(
        replace(link, collisions=tuple(part for shape in link.collisions for part in export.split_capsule(shape)))
        for link in tree.links))


def _joints(tree: Tree, at: dict[str, int], palm: str) -> HandJoints:
    order = {joint.name: number for number, joint in enumerate(tree.joints)}
    wrist = {joint.name for joint in tree.path(palm)}
    couplings = [joint.coupling for joint in tree.joints]
    numbers = {key: np.array([getattr(j, key) for j in tree.joints]) for key in ("lower", "upper", "effort", "velocity")}
    return HandJoints(
        name=tuple(order), kind=tuple(joint.kind for joint in tree.joints),
        role=tuple(_role(joint, wrist) for joint in tree.joints),
        parent=np.array([at[joint.parent] for joint in tree.joints], np.int32),
        child=np.array([at[joint.child] for joint in tree.joints], np.int32),
        T_parent_joint=np.array([joint.T_parent_joint for joint in tree.joints]),
        axis=np.array([joint.axis for joint in tree.joints]), **numbers,
        driver=np.array([-1 if c is None else order[c.driver] for c in couplings], np.int32),
        ratio=np.array([0.0 if c is None else c.ratio for c in couplings]),
        offset=np.array([0.0 if c is None else c.offset for c in couplings]),
    )  # fmt: skip


def _role(joint: Joint, wrist: set[str]) -> str:
    if joint.kind == "fixed":
        return "fixed"
    if joint.coupling is not None:
        return "coupled"
    return "wrist" if joint.name in wrist else "actuated"


def _fingers(found: tuple[Finger, ...], at: dict[str, int]) -> HandFingers:
    links = {key: np.array([at[getattr(finger, key)] for finger in found], np.int32)
             for key in ("base_link", "middle_link", "tip_link")}
    tips = np.array([finger.tip_m for finger in found], np.float64)
    return HandFingers(tuple(finger.name for finger in found), **links, tip_m=tips)


def _contacts(tree: Tree, at: dict[str, int], found: tuple[Finger, ...]) -> np.ndarray:
    """Return the pairs of links that may touch, (k, 2).

    The source's own pairs when it lists them; else all pairs of links of different fingers, and the thumb's last link with the
    palm.
    """
    pairs = tree.contacts
    if pairs is None:
        bodies = {link.name for link in tree.links if link.collisions}
        palm = common_link(tree, [finger.tip_link for finger in found])
        below = [[j.child for j in below_link(tree.path(f.tip_link), palm) if j.child in bodies] for f in found]
        crossing = [(a, b) for k, one in enumerate(below) for other in below[k + 1 :] for a in one for b in other]
        pairs = (*crossing, *((palm, link) for link in below[0][-1:] if palm in bodies))
    return np.array(sorted(sorted((at[a], at[b])) for a, b in pairs), np.int32).reshape(-1, 2)


BASE = "gantry"
STEPS = ("x", "y", "z", "yaw", "pitch", "roll")
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
        "yaw": (0.0, 0.0, 1.0), "pitch": (0.0, 1.0, 0.0), "roll": (1.0, 0.0, 0.0)}  # fmt: skip
TURN_RAD = {"yaw": np.pi, "pitch": np.pi / 2, "roll": np.pi}
"""pitch is the middle angle because it must stay clear of a right angle, at which yaw and roll become the same turn"""
INERTIA_KGM2 = 1e-4
SPEED_M_S, SPEED_RAD_S = 2.0, 6.0


@dataclass(frozen=True)
class Gantry:
    """A 6-DoF wrist: three slides and three hinges (x, y, z, yaw, pitch, roll) between a fixed base and the root of a hand."""

    reach_m: float
    """range of each slide, both ways"""
    force_n: float
    torque_nm: float
    mass_kg: float
    """mass of each of the six parts"""


def mount_on_gantry(tree: Tree, gantry: Gantry) -> Tree:
    """Mount a hand on a gantry: the pose of its root is T(x, y, z) Rz(yaw) Ry(pitch) Rx(roll).

    SourceError when the hand has links or joints with the names of the gantry's.
    """
    names = [BASE, *(f"{BASE}_{step}" for step in STEPS[:-1])]
    inertia = np.eye(3) * INERTIA_KGM2
    links = tuple(Link(name, gantry.mass_kg, inertia_kgm2=inertia) for name in names)
    children = [*names[1:], tree.links[0].name]
    joints = tuple(_gantry_joint(step, parent, child, gantry) for step, parent, child in zip(STEPS, names, children, strict=True))
    return ordered(replace(tree, links=(*links, *tree.links), joints=(*joints, *tree.joints)))


def _gantry_joint(step: str, parent: str, child: str, gantry: Gantry) -> Joint:
    turns = step in TURN_RAD
    far = TURN_RAD.get(step, gantry.reach_m)
    return Joint(f"wrist_{step}", "revolute" if turns else "prismatic", parent, child, np.eye(4), AXES[step], -far, far,
                 gantry.torque_nm if turns else gantry.force_n, SPEED_RAD_S if turns else SPEED_M_S)


def couple_joints(tree: Tree, pairs: Sequence[str]) -> Tree:
    """Add couplings, each written follower=driver, to a tree.

    SourceError for joints that do not exist, do not move, or cannot be coupled.
    """
    wanted = {follower: driver for follower, _, driver in (pair.partition("=") for pair in pairs)}
    moves = {joint.name for joint in tree.joints if joint.kind != "fixed"}
    for follower, driver in wanted.items():
        if not moves.issuperset((follower, driver)):
            raise SourceError(f"{tree.name}, coupled", "follower=driver, two joints that move", f"{follower}={driver}",
                              f"choose from {', '.join(sorted(moves))}")
    joints = tuple(replace(j, coupling=Coupling(wanted[j.name])) if j.name in wanted else j for j in tree.joints)
    _check_drivers(tree.name, {j.name: j.coupling.driver for j in joints if j.coupling is not None}, moves)
    return replace(tree, joints=joints)


def _check_drivers(name: str, drivers: dict[str, str], moves: set[str]) -> None:
    for follower, driver in drivers.items():
        if driver not in moves or driver in drivers:
            raise SourceError(f"{name}, joint {follower!r}", "to follow a joint with a motor", repr(driver),
                              "name that joint as its driver")
