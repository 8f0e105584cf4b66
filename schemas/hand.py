"""Robot hand (joints, fingers, links, meshes) and its motion: references, targets, retargeting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.grasp import GraspObject
from schemas.spec import Bundle, Schema, array, value

if TYPE_CHECKING:
    import numpy as np

FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True)
class HandJoints(Schema):
    """Joints, parents before children. Joint k carries link k + 1; link 0 is the root.

    The d joints that are not fixed are the degrees of freedom; a configuration q (d,) lists them in this order.
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
    """Fingers, thumb first, and their keypoints for imitation (AffordDex, HTI)."""

    name: tuple[str, ...] = value("f of thumb, index, middle, ring, little, in this order; hands may lack some")
    base_link: np.ndarray = array("f", "int32", "link whose origin is the base joint (level 1)")
    middle_link: np.ndarray = array("f", "int32", "link whose origin is the middle joint (level 2)")
    tip_link: np.ndarray = array("f", "int32", "last link")
    tip_m: np.ndarray = array("f 3", "float64", "the fingertip", unit="m", frame="tip link")


@dataclass(frozen=True)
class HandMesh(Schema):
    """Mesh that the URDF references."""

    file: str = value("its name in the URDF, e.g. meshes/palm.obj")
    vertices: np.ndarray = array("v 3", "float32", "corners, scaled as the hand wants them", unit="m")
    faces: np.ndarray = array("t 3", "int32", "vertex indices, counter-clockwise seen from outside")


@dataclass(frozen=True)
class HandModel(Schema):
    """Robot hand, from its root (6-DoF gantry, forearm or palm) to the fingertips."""

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


KEYPOINTS = ("wrist", "thumb_cmc", "thumb_mcp", "thumb_ip", "thumb_tip", "index_mcp", "index_pip", "index_dip", "index_tip",
             "middle_mcp", "middle_pip", "middle_dip", "middle_tip", "ring_mcp", "ring_pip", "ring_dip", "ring_tip",
             "little_mcp", "little_pip", "little_dip", "little_tip")  # fmt: skip
"""keypoint order of MediaPipe and OpenPose; readers convert others (MANO, DexYCB) to it"""
PHASES = ("unknown", "reach", "close", "hold", "lift")


@dataclass(frozen=True)
class HandMotion(Schema):
    """Motion of one human hand in one clip; a single frame is a pose. Without a tracked wrist, the wrist is the origin."""

    name: str = value("id of the clip, unique in its source")
    source: str = value("where it comes from: keypoints, dexycb, oakink2, synthetic")
    side: str = value("left or right")
    rate_hz: float = value("frames a second", unit="Hz")
    keypoints_m: np.ndarray = array("t 21 3", "float64", "in the order of KEYPOINTS", unit="m", frame="world, z up")
    phase: np.ndarray = array("t", "uint8", "index into PHASES")
    object_name: str = value("what is grasped; '' where nothing is, or nothing is known of it")
    object_pose: np.ndarray = array("o 7", "float64", "x y z, quaternion x y z w; o = t, or 0 where not known", unit="m",
                                    frame="world")
    T_world_palm: np.ndarray = array("p 4 4", "float64", "pose of the palm as the source has it; p = t, or 0 where it has none",
                                     unit="m")


@dataclass(frozen=True)
class GraspTarget(Schema):
    """Graspable handle of an object: the input of motion synthesis."""

    name: str = value("id")
    object_name: str = value("which object")
    object_pose: np.ndarray = array("7", "float64", "x y z, quaternion x y z w", unit="m", frame="world, z up")
    T_object_handle: np.ndarray = array("4 4", "float64", "origin amid the handle, z along it", unit="m")
    diameter_m: float = value("how thick the handle is between the fingers", unit="m")


@dataclass(frozen=True)
class HandReference(Schema):
    """Reference motion that a robot hand imitates, in its own degrees of freedom (AffordDex, HTI)."""

    name: str = value("id of the clip")
    hand: str = value("name of the hand")
    side: str = value("side of the hand; that of the person may have been the other, see mirrored")
    mirrored: bool = value("whether the motion was mirrored in the plane x = 0; its object is then a mirror image too")
    rate_hz: float = value("frames a second", unit="Hz")
    q: np.ndarray = array("t d", "float64", "the joints that move, see HandJoints; within their limits", unit="rad or m")
    qd: np.ndarray = array("t d", "float64", "their smoothed speed", unit="rad/s or m/s")
    T_world_palm: np.ndarray = array("t 4 4", "float64", "pose of the palm's link", unit="m")
    palm_twist: np.ndarray = array("t 6", "float64", "smoothed linear, then angular velocity of the palm", unit="m/s, rad/s",
                                   frame="world")
    level_1_m: np.ndarray = array("t f 3", "float64", "where each finger leaves the palm", unit="m", frame="world")
    level_2_m: np.ndarray = array("t f 3", "float64", "one phalanx further", unit="m", frame="world")
    tips_m: np.ndarray = array("t f 3", "float64", "fingertips, thumb first", unit="m", frame="world")
    phase: np.ndarray = array("t", "uint8", "index into PHASES")
    object_name: str = value("what is grasped, or ''")
    object_pose: np.ndarray = array("o 7", "float64", "x y z, quaternion x y z w; o = t, or 0", unit="m", frame="world")
    T_world_source: np.ndarray = array("4 4", "float64", "how the source's world was turned about z and shifted, after mirroring",
                                       unit="m")
    error_m: np.ndarray = array("t", "float64", "mean distance of the hand's points from where the person's would be", unit="m")
    bone_error_rad: np.ndarray = array("t", "float64", "mean angle between the bones of both hands", unit="rad")


@dataclass(frozen=True)
class RetargetVerdict(Schema):
    """Result of the retargeting of one clip; -1 for a figure that was not computed."""

    name: str = value("id of the clip")
    source: str = value("where it comes from")
    kept: bool = value("whether it may be imitated")
    reason: str = value("'' where kept, else the first rule that it broke, e.g. 'too short'")
    detail: str = value("the figure and the limit, in words; '' where kept")
    mirrored: bool = value("whether a motion of the other side was mirrored")
    frames: int = value("frames that were retargeted")
    error_mean_m: float = value("tracking error over all frames", unit="m")
    error_p95_m: float = value("that 95 % of frames stay below", unit="m")
    bone_error_rad: float = value("mean angle between bones", unit="rad")
    joint_speed_rad_s: float = value("fastest finger joint", unit="rad/s")
    palm_speed_m_s: float = value("fastest palm", unit="m/s")


@dataclass(frozen=True)
class Retargeted(Schema):
    """Retargeted clip and its verdict."""

    name: str = value("id of the clip")
    verdict: RetargetVerdict = value("kept or dropped, and why")
    references: tuple[HandReference, ...] = value("one where kept, else none")


@dataclass(frozen=True)
class RetargetReport(Schema):
    """Verdicts of all clips."""

    name: str = value("name of the hand")
    verdicts: tuple[RetargetVerdict, ...] = value("by name")
    kept: int = value("how many clips may be imitated")
    dropped: tuple[str, ...] = value("'reason: number' of every reason, most frequent first")


@dataclass(frozen=True)
class ReferenceSet(Schema):
    """Reference motions that a robot hand imitates."""

    name: str = value("name of the hand")
    references: tuple[HandReference, ...] = value("by name")
    report: RetargetReport = value("what was kept and what was dropped")


@dataclass(frozen=True)
class MotionsRead(Bundle):
    """Output of recordings_read: the motions of a source, and a verdict on every recording that cannot be used."""

    report: RetargetReport = value("verdicts of unusable recordings; none is kept")
    motions: tuple[HandMotion, ...] = value("all others, in the order of the source")


@dataclass(frozen=True)
class GraspClips(Bundle):
    """Output of human_motion: clips of recorded grasps, and a verdict on every motion that does not become one."""

    report: RetargetReport = value("verdicts of the motions that were left out; none is kept")
    targets: tuple[GraspTarget, ...] = value("place of the grasp of each clip, by the name of its motion")
    motions: tuple[HandMotion, ...] = value("reach, close, hold and lift; each is named <target>_000")


@dataclass(frozen=True)
class ProvenClips(Bundle):
    """Output of clip_proof: everything that a prior learns from."""

    references: ReferenceSet = value("clips that lift their object; the report has every verdict")
    bodies: tuple[GraspObject, ...] = value("objects of these clips")
    targets: tuple[GraspTarget, ...] = value("targets of these clips")
