"""Joints without a motor follow another one: q = A u + b, where u holds the wrist and the motors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from afford.common.errors import SourceError
from afford.grasping.hand.kinematics import moving
from afford.grasping.hand.tree import Coupling, Tree
from schemas.hand import HandJoints


def driven(joints: HandJoints) -> np.ndarray:
    """(m,) indices of the joints that are commanded, wrist first: the columns of u."""
    return np.array([k for k, role in enumerate(joints.role) if role in ("wrist", "actuated")], np.int64)


def commanded(joints: HandJoints) -> np.ndarray:
    """(m,) where the joints that are commanded stand in q: u is q[commanded]."""
    return np.searchsorted(moving(joints), driven(joints))


def limits_u(joints: HandJoints) -> np.ndarray:
    """(m, 2) lowest and highest position of the joints that are commanded, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[driven(joints)]


def spread(joints: HandJoints) -> tuple[np.ndarray, np.ndarray]:
    """A (d, m) and b (d,): q = A u + b. A Jacobian by q times A is one by u."""
    rows, columns = moving(joints), driven(joints)
    follows = np.where(joints.driver[rows] < 0, rows, joints.driver[rows])
    ratio = np.where(joints.driver[rows] < 0, 1.0, joints.ratio[rows])
    return (follows[:, None] == columns) * ratio[:, None], joints.offset[rows].copy()


def coupled(tree: Tree, pairs: Sequence[str]) -> Tree:
    """The tree with more couplings, each written follower=driver; SourceError when they are not joints that can be coupled."""
    wanted = {follower: driver for follower, _, driver in (pair.partition("=") for pair in pairs)}
    moves = {joint.name for joint in tree.joints if joint.kind != "fixed"}
    for follower, driver in wanted.items():
        if not moves.issuperset((follower, driver)):
            raise SourceError(f"{tree.name}, coupled", "follower=driver, two joints that move", f"{follower}={driver}",
                              f"choose among {', '.join(sorted(moves))}")
    joints = tuple(replace(j, coupling=Coupling(wanted[j.name])) if j.name in wanted else j for j in tree.joints)
    _check(tree.name, {j.name: j.coupling.driver for j in joints if j.coupling is not None}, moves)
    return replace(tree, joints=joints)


def _check(name: str, drivers: dict[str, str], moves: set[str]) -> None:
    for follower, driver in drivers.items():
        if driver not in moves or driver in drivers:
            raise SourceError(f"{name}, joint {follower!r}", "to follow a joint with a motor", repr(driver),
                              "name that joint as its driver")
