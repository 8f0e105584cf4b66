"""Fingers of a robot hand: their last links and tips, the palm, and the axes and side of the palm.

The axes of the palm come from the way that the middle finger closes: x to a right hand's thumb, y out of the back, z to the
fingers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.errors import SourceError
from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, moving_joints, points_on_links
from afford.grasping.hand.link_meshes import farthest_point
from afford.grasping.hand.tree import Joint, Tree
from schemas.hand import FINGERS, HandFingers, HandJoints

WORDS = {"thumb": ("th",), "index": ("ff", "index", "fore"), "middle": ("mf", "middle"), "ring": ("rf", "ring"),
         "little": ("lf", "little", "pinky")}  # fmt: skip
"""finger -> possible beginnings of a word in the name of its last link"""
SAME_M = 1e-3
"""joints closer than this count as one knuckle"""


@dataclass(frozen=True, eq=False)
class Finger:
    """Links of one finger: the two joints that imitation compares, and the tip."""

    name: str
    base_link: str
    middle_link: str
    tip_link: str
    tip_m: np.ndarray
    """(3,) in the frame of tip_link"""


def find_fingers(tree: Tree, named: Sequence[str] = ()) -> tuple[Finger, ...]:
    """Find the fingers of a hand, thumb first.

    `named` lists finger=last link for hands whose link names do not say it. SourceError without a thumb or without another finger.
    """
    leaves = dict(_named(tree, named)) if named else _guessed(tree)
    if "thumb" not in leaves or len(leaves) < 2:
        raise SourceError(f"{tree.name}, fingers", "a thumb and another finger among the last links",
                          f"{', '.join(tree.leaves())}", "set fingers=thumb=LINK,index=LINK,...")
    palm = common_link(tree, list(leaves.values()))
    return tuple(_finger(tree, palm, name, leaves[name]) for name in FINGERS if name in leaves)


def common_link(tree: Tree, links: Sequence[str]) -> str:
    """Return the last link that is an ancestor of all `links`: for fingertips, the palm."""
    paths = [[tree.links[0].name, *(joint.child for joint in tree.path(link))] for link in links]
    return [steps[0] for steps in zip(*paths, strict=False) if len(set(steps)) == 1][-1]


def below_link(path: list[Joint], link: str) -> list[Joint]:
    """Return the joints of a path that come after one of its links."""
    return path[[joint.parent for joint in path].index(link) :]


def _named(tree: Tree, named: Sequence[str]) -> list[tuple[str, str]]:
    pairs = [(name, link) for name, _, link in (pair.partition("=") for pair in named)]
    known = {link.name for link in tree.links}
    for name, link in pairs:
        if name not in FINGERS or link not in known:
            raise SourceError(f"{tree.name}, fingers", f"FINGER=LINK with a finger of {', '.join(FINGERS)} and a link of the hand",
                              f"{name}={link}", f"choose among {', '.join(tree.leaves())}")
    return pairs


def _guessed(tree: Tree) -> dict[str, str]:
    out: dict[str, str] = {}
    for leaf in tree.leaves():
        words = re.split(r"[^a-z]+", leaf.lower())
        name = next((finger for finger, starts in WORDS.items() if any(word.startswith(starts) for word in words)), None)
        if name is not None:
            out.setdefault(name, leaf)
    return out


def _finger(tree: Tree, palm: str, name: str, leaf: str) -> Finger:
    """Build one finger.

    The tip is a frame fixed beyond the last joint, else the point that the source names, else the farthest point of the shapes.
    """
    chain = below_link(tree.path(leaf), palm)
    last = max((k for k, joint in enumerate(chain) if joint.kind != "fixed"), default=-1)
    if last < 0:
        raise SourceError(f"{tree.name}, finger {name}", f"joints that move between {palm!r} and {leaf!r}", "fixed joints only",
                          "name the right links in fingers")
    knuckles = _knuckles(chain[: last + 1])
    return Finger(name, knuckles[-3 if len(knuckles) > 2 else 0], knuckles[-2 if len(knuckles) > 1 else 0],
                  chain[last].child, _tip(tree, chain[last].child, chain[last + 1 :]))


def _knuckles(chain: Sequence[Joint]) -> list[str]:
    """Return the last link at every place where the finger bends."""
    out: list[str] = []
    T, at = np.eye(4), np.full(3, np.inf)
    for joint in chain:
        T = T @ joint.T_parent_joint
        if joint.kind == "fixed":
            continue
        if np.linalg.norm(T[:3, 3] - at) < SAME_M:
            out[-1] = joint.child
        else:
            out.append(joint.child)
        at = T[:3, 3]
    return out


def _tip(tree: Tree, link: str, beyond: Sequence[Joint]) -> np.ndarray:
    if link in tree.tips:
        return np.asarray(tree.tips[link], np.float64)
    T = np.eye(4)
    for joint in beyond:
        T = T @ joint.T_parent_joint
    return T[:3, 3].copy() if beyond else farthest_point(tree, link)


STRAIGHT = ("middle", "index", "ring", "little")
"""fingers by preference for the axes of the palm; the first that the hand has is used"""
ONE_WAY = 0.2
"""a joint bends one way when the sum of its limits exceeds this share of its range; other joints swing sideways"""


def grip_axes(joints: HandJoints, fingers: HandFingers, palm: int) -> np.ndarray:
    """Compute the axes x, y, z of the grip in the palm frame, as the columns of a (3, 3) rotation.

    z runs along the straight finger; the fingertip moves towards -y when the finger bends.
    """
    k = next(fingers.name.index(name) for name in STRAIGHT if name in fingers.name)
    root, straight = _finger_ends(joints, fingers, palm, k, 0.0)
    _, bent = _finger_ends(joints, fingers, palm, k, 0.25)
    z = _unit(straight - root)
    back = -(bent - straight)
    y = _unit(back - z * (back @ z))
    return np.stack([np.cross(y, z), y, z], axis=1) + 0.0  # no minus zero


def hand_side(joints: HandJoints, fingers: HandFingers, palm: int, R_palm_grip: np.ndarray) -> str:
    """Return right when the thumb lies towards +x of the grip axes, else left."""
    thumb, _ = _finger_ends(joints, fingers, palm, fingers.name.index("thumb"), 0.0)
    others = [_finger_ends(joints, fingers, palm, k, 0.0)[0] for k, name in enumerate(fingers.name) if name != "thumb"]
    return "right" if (thumb - np.mean(others, axis=0)) @ R_palm_grip[:, 0] > 0 else "left"


def _finger_ends(joints: HandJoints, fingers: HandFingers, palm: int, finger: int, bend: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the base and the tip of a finger in the palm frame.

    Joints that bend one way are at `bend` of their range, all others at 0 or at the limit nearest to 0.
    """
    low, high = joint_limits(joints).T
    still = np.clip(0.0, low, high)
    of_finger = np.array([joints.role[k] in ("actuated", "coupled") for k in moving_joints(joints)])
    one_way = of_finger & (np.abs(low + high) > ONE_WAY * (high - low))
    q = np.where(one_way, np.where(high > -low, bend * high, bend * low), still)
    T = forward_kinematics(joints, q[None])
    links = np.array([fingers.base_link[finger], fingers.tip_link[finger]])
    ends = points_on_links(T, links, np.stack([np.zeros(3), fingers.tip_m[finger]]))[0]
    T_palm_root = np.linalg.inv(T[0, palm])
    base, tip = ends @ T_palm_root[:3, :3].T + T_palm_root[:3, 3]
    return base, tip


def _unit(vector: np.ndarray) -> np.ndarray:
    found: np.ndarray = vector / np.linalg.norm(vector)
    return found
