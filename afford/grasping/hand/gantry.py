"""A 6-DoF wrist: three slides and three hinges (x, y, z, yaw, pitch, roll) that carry the root of a hand from a fixed base."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.grasping.hand.tree import Joint, Link, Tree, ordered

BASE = "gantry"
STEPS = ("x", "y", "z", "yaw", "pitch", "roll")
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
        "yaw": (0.0, 0.0, 1.0), "pitch": (0.0, 1.0, 0.0), "roll": (1.0, 0.0, 0.0)}  # fmt: skip
TURN_RAD = {"yaw": np.pi, "pitch": np.pi / 2, "roll": np.pi}
"""pitch in the middle: it is the one that must stay clear of a right angle, where yaw and roll become the same"""
INERTIA_KGM2 = 1e-4
SPEED_M_S, SPEED_RAD_S = 2.0, 6.0


@dataclass(frozen=True)
class Gantry:
    """How far and how hard."""

    reach_m: float
    """the slides go this far both ways"""
    force_n: float
    torque_nm: float
    mass_kg: float
    """of each of its six parts"""


def mounted(tree: Tree, gantry: Gantry) -> Tree:
    """The hand on its gantry; the pose of its root is T(x, y, z) Rz(yaw) Ry(pitch) Rx(roll). SourceError when the hand has links or
    joints of the gantry's names.
    """
    names = [BASE, *(f"{BASE}_{step}" for step in STEPS[:-1])]
    inertia = np.eye(3) * INERTIA_KGM2
    links = tuple(Link(name, gantry.mass_kg, inertia_kgm2=inertia) for name in names)
    children = [*names[1:], tree.links[0].name]
    joints = tuple(_joint(step, parent, child, gantry) for step, parent, child in zip(STEPS, names, children, strict=True))
    return ordered(replace(tree, links=(*links, *tree.links), joints=(*joints, *tree.joints)))


def _joint(step: str, parent: str, child: str, gantry: Gantry) -> Joint:
    turns = step in TURN_RAD
    far = TURN_RAD.get(step, gantry.reach_m)
    return Joint(f"wrist_{step}", "revolute" if turns else "prismatic", parent, child, np.eye(4), AXES[step], -far, far,
                 gantry.torque_nm if turns else gantry.force_n, SPEED_RAD_S if turns else SPEED_M_S)
