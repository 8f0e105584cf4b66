"""A robot hand: links, joints, fingers and shapes, as a table for kinematics and as a URDF for physics engines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True)
class HandJoints(Schema):
    """The joints, parents before children. Joint k carries link k + 1; link 0 is the root.

    The d joints that are not fixed are the degrees of freedom; a configuration q (d,) has them in this order.
    """

    name: tuple[str, ...] = value("j names")
    kind: tuple[str, ...] = value("j times revolute, prismatic or fixed")
    role: tuple[str, ...] = value("j times wrist (between root and palm), actuated (a finger's own motor), coupled or fixed")
    parent: np.ndarray = array("j", "int32", "index of the link that the joint hangs on")
    child: np.ndarray = array("j", "int32", "index of the link that it carries: k + 1")
    T_parent_joint: np.ndarray = array("j 4 4", "float64", "place of the joint, and of its link at q = 0", unit="m", frame="parent")
    axis: np.ndarray = array("j 3", "float64", "unit axis that it turns about or slides along; zero where fixed", frame="joint")
    lower: np.ndarray = array("j", "float64", "smallest position", unit="rad, or m where prismatic")
    upper: np.ndarray = array("j", "float64", "largest position", unit="rad, or m where prismatic")
    effort: np.ndarray = array("j", "float64", "largest torque or force", unit="N m, or N where prismatic")
    velocity: np.ndarray = array("j", "float64", "largest speed", unit="rad/s, or m/s where prismatic")
    driver: np.ndarray = array("j", "int32", "the joint that a coupled joint follows, -1 for every other")
    ratio: np.ndarray = array("j", "float64", "q = ratio * q[driver] + offset where coupled, else 0")
    offset: np.ndarray = array("j", "float64", "see ratio", unit="rad, or m where prismatic")


@dataclass(frozen=True)
class HandFingers(Schema):
    """The fingers, thumb first, and the points of them that imitation looks at (AffordDex, HTI)."""

    name: tuple[str, ...] = value("f of thumb, index, middle, ring, little, in this order; hands may lack some")
    base_link: np.ndarray = array("f", "int32", "link whose origin is the base joint (level 1)")
    middle_link: np.ndarray = array("f", "int32", "link whose origin is the middle joint (level 2)")
    tip_link: np.ndarray = array("f", "int32", "last link")
    tip_m: np.ndarray = array("f 3", "float64", "the fingertip", unit="m", frame="tip link")


@dataclass(frozen=True)
class HandMesh(Schema):
    """A mesh that the URDF names."""

    file: str = value("its name in the URDF, e.g. meshes/palm.obj")
    vertices: np.ndarray = array("v 3", "float32", "corners, scaled as the hand wants them", unit="m")
    faces: np.ndarray = array("t 3", "int32", "vertex indices, counter-clockwise seen from outside")


@dataclass(frozen=True)
class HandModel(Schema):
    """A hand, from the root (of its 6-DoF gantry, its forearm or its palm) to the fingertips."""

    name: str = value("what it is called, e.g. shadow")
    side: str = value("left or right: where the thumb is when the palm is seen")
    urdf: str = value("the hand as URDF: inertia, collision and visual shapes; meshes by file name")
    links: tuple[str, ...] = value("l = j + 1 names, root first, parents before children")
    mass_kg: np.ndarray = array("l", "float64", "mass of each link", unit="kg")
    rgb: np.ndarray = array("l 3", "uint8", "colour of each link, sRGB")
    joints: HandJoints = value("how links move")
    fingers: HandFingers = value("fingertips and keypoints")
    palm: int = value("index of the palm's link")
    R_palm_grip: np.ndarray = array("3 3", "float64", "columns: x to a right hand's thumb, y out of the back, z to the fingers",
                                    frame="palm")
    contacts: np.ndarray = array("p 2", "int32", "pairs of links that may touch each other; all others must be switched off")
    meshes: tuple[HandMesh, ...] = value("what the URDF names")
