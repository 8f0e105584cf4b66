"""Turn recorded grasps into clips that an episode can show, on the scan on which each was recorded, or on a tool.

A recording with the pose of its object keeps the hand where it was relative to the object. The scan is put on the table in the
recorded orientation, in which it must rest. A recording without, such as that of a plain video, keeps the posture of the hand at
the grasp. The tool whose place is nearly as thick as the hand is open comes between its fingertips.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.task import placed_pose, target_at
from afford.grasping.imitation.clip_shape import ClipShape, shaped_clip
from afford.grasping.motion.clip_rules import BrokenRule, dropped, report_of
from afford.grasping.motion.retarget import mirror_motion
from afford.grasping.motion.skeleton import aperture, opposing
from afford.grasping.motion.synthetic import PAD_M, place_grasp
from afford.grasping.motion.targets import grip_axes
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import laid_rest_pose
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import aim_along_axis
from schemas.grasp import GraspObject
from schemas.hand import PHASES, GraspClips, GraspTarget, HandModel, HandMotion, RetargetVerdict

EVALUATION_SCANS = ("pitcher", "bleach", "mug", "drill", "scissors")
"""words in the names of scans that policies are evaluated on; a prior never learns from them"""
RISE_M = 0.01
"""rise of the object from which it has been grasped"""
FITS_M = 0.015
"""largest difference between the thickness of a tool and the opening of a hand that grasps it"""
PALM = [0, 5, 9, 13, 17]
"""keypoints of the palm"""
FROM_ABOVE = np.array([0.0, -0.741, -0.672])
"""approach of a hand whose object is not known; that of synthetic clips (maps/settings/grasping.py)"""
Clip = tuple[GraspTarget, HandMotion]


def grasp_clips(motions: Sequence[HandMotion], scans: Sequence[GraspObject], places: Sequence[GraspTarget], hand: HandModel,
                shape: ClipShape, engine: str) -> GraspClips:  # fmt: skip
    """Build the clips of all motions; ValueError when none becomes a clip. `places` are those of tools."""
    left_out, clips = list[RetargetVerdict](), list[Clip]()
    for motion in motions:
        broken = unusable(motion, hand, scans)
        scan = None if broken else scan_of(motion, scans)
        made = broken or (_on_tool(motion, hand, places, shape) if scan is None else _on_scan(motion, hand, scan, shape, engine))
        if isinstance(made, BrokenRule):
            left_out.append(dropped(motion.name, motion.source, made, len(motion.keypoints_m)))
        else:
            clips.append(made)
    report = report_of("human_motion", left_out)
    if not clips:
        raise ValueError(f"human_motion: no motion of {len(motions)} becomes a clip of a grasp; {', '.join(report.dropped)}")
    targets, made_motions = zip(*clips, strict=True)
    return GraspClips(report, targets, made_motions)


def is_evaluation_scan(name: str) -> bool:
    """Return true for the name of a scan that policies are evaluated on."""
    return any(word in name.lower() for word in EVALUATION_SCANS)


def scan_of(motion: HandMotion, scans: Sequence[GraspObject]) -> GraspObject | None:
    """Find the scan of a motion whose object has a pose: of the same name, apart from a number before it as in 011_banana."""
    there = [one for one in scans if one.name.lstrip("0123456789_") == motion.object_name.lstrip("0123456789_")]
    return there[0] if there and motion.object_name and len(motion.object_pose) else None


def unusable(motion: HandMotion, hand: HandModel, scans: Sequence[GraspObject]) -> BrokenRule | None:
    """Check what a motion must have to become a clip; None when it has all."""
    if is_evaluation_scan(motion.object_name):
        return BrokenRule("evaluation scan", f"{motion.object_name} is kept for evaluation")
    if len(motion.object_pose) and motion.object_name and scan_of(motion, scans) is None:
        return BrokenRule("no scan", f"the source has no mesh named {motion.object_name}")
    if scan_of(motion, scans) is not None and motion.side != hand.side:
        return BrokenRule("other hand", f"a {motion.side} hand; mirrored, it would need a mirrored scan")
    if grasp_frame(motion) is None:
        return BrokenRule("no grasp", "no frame of phase hold or lift, and no object that rises")
    return None


def grasp_frame(motion: HandMotion) -> int | None:
    """Find the frame of the grasp: the first of hold or lift, or where the object rises; None without a grasp."""
    held = np.isin(motion.phase, [PHASES.index("hold"), PHASES.index("lift")])
    if not held.any() and len(motion.object_pose):
        held = motion.object_pose[:, 2] > motion.object_pose[0, 2] + RISE_M
    return int(held.argmax()) if held.any() else None


def _on_scan(motion: HandMotion, hand: HandModel, body: GraspObject, shape: ClipShape, engine: str) -> Clip | BrokenRule:
    """Build the clip on its scan.

    Of the two frames of an episode, half a turn apart, the clip has the one in which the hand is at +y, as in synthetic clips.
    """
    way = _in_object(motion)[: (grasp_frame(motion) or 0) + 1]
    turn = Rotation.from_quat(motion.object_pose[len(way) - 1, 3:])
    scene = Scene(hand, body)
    rest = _resting(scene, turn, engine, shape.tilt_deg)
    if isinstance(rest, BrokenRule):
        return rest
    pose = placed_pose(body, rest, np.zeros(2), -aim_along_axis(scene, rest, 0.0).yaw)
    if _moved(way[-1:, PALM], pose)[0, :, 1].mean() < 0:
        pose = placed_pose(body, pose, np.zeros(2), np.pi)
    way = _moved(way, pose)
    centre = (way[-1, 4] + opposing(way[-1:])[0]) / 2
    target = target_at(scene, pose, float(centre[0]), (0.0, 1.0), motion.name)
    return target, shaped_clip(motion, way, target, shape)


def _resting(scene: Scene, turn: Rotation, engine: str, tilt_deg: float) -> np.ndarray | BrokenRule:
    """Return the (7,) pose in which the object rests after it was laid down in an orientation."""
    world, up = make_world(engine, scene), np.array([0.0, 0.0, 1.0])
    rest = laid_rest_pose(world, scene, turn)
    world.close()
    if rest is None:
        return BrokenRule("does not rest", f"{scene.body.name} keeps rolling in the recorded orientation")
    tilt = np.rad2deg(np.arccos(np.clip(turn.inv().apply(up) @ Rotation.from_quat(rest[3:]).inv().apply(up), -1, 1)))
    if tilt > tilt_deg:
        return BrokenRule("tips over", f"{scene.body.name} rests {tilt:.0f} degrees of {tilt_deg:g} from the recorded orientation")
    return rest


def _on_tool(motion: HandMotion, hand: HandModel, places: Sequence[GraspTarget], shape: ClipShape) -> Clip | BrokenRule:
    """Build the clip on the tool whose place fits the hand best."""
    ours = motion if motion.side == hand.side else mirror_motion(motion)
    grasp = ours.keypoints_m[grasp_frame(motion) or 0][None]
    opened = float(aperture(grasp)[0]) - 2 * PAD_M
    best = min(places, key=lambda one: abs(one.diameter_m - opened), default=None)
    if best is None or abs(best.diameter_m - opened) > FITS_M:
        return BrokenRule("no tool", f"the hand is {1000 * opened:.0f} mm open, and no tool is as thick")
    local = (grasp - grasp[:, :1]) @ grip_axes(grasp, ours.side)[0]
    T = place_grasp(best, local[0], opened, come=FROM_ABOVE).T_world_wrist
    target = GraspTarget(motion.name, best.object_name, best.object_pose, best.T_object_handle, best.diameter_m)
    return target, shaped_clip(ours, local @ T[:3, :3].T + T[:3, 3], target, shape)


def _in_object(motion: HandMotion) -> np.ndarray:
    """Return keypoints (t, 21, 3) in the frame of the object."""
    turn = Rotation.from_quat(motion.object_pose[:, 3:]).as_matrix()
    found: np.ndarray = np.einsum("tji,tkj->tki", turn, motion.keypoints_m - motion.object_pose[:, None, :3])
    return found


def _moved(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    turn = Rotation.from_quat(pose[3:]).as_matrix()
    found: np.ndarray = points @ turn.T + pose[:3]
    return found
