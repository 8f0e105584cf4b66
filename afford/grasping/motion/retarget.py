"""Retarget human hand motion to a robot hand (AffordDex, HTI), or say why a clip is dropped.

Clips of the other side are mirrored. The fitted palm is converted to positions of the gantry that carries it: x, y, z, yaw, pitch,
roll. Speeds are gradients in time, smoothed by a Gaussian of two frames, as in AffordDex's imitation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, moving_joints
from afford.grasping.hand.model import STEPS
from afford.grasping.motion import clip_rules
from afford.grasping.motion.clip_rules import BrokenRule, ClipRules
from afford.grasping.motion.fit import FitState, FitWeights, RetargetProblem, fit_clip, fit_frames
from afford.grasping.motion.targets import LEVEL_1, LEVEL_2, OF_FINGER, TIP, bone_angles, hand_points, scaled_targets
from schemas.hand import HandModel, HandMotion, HandReference, Retargeted, RetargetVerdict


def centred_world(motion: HandMotion, palm: np.ndarray) -> np.ndarray:
    """Compute T_world_source (4, 4), a rotation and shift about z, which leaves gravity unchanged.

    The mean yaw of the gantry becomes 0, so that it stays far from its limits. The object of the first frame, or else the palm, is
    at x = y = 0. palm (t, 4, 4) is in the source's world.
    """
    toward = palm[:, :2, 0].mean(axis=0)
    yaw = np.arctan2(toward[1], toward[0]) if np.linalg.norm(toward) > 1e-6 else 0.0
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.eye(4)
    T[:2, :2] = [[c, s], [-s, c]]
    start = motion.object_pose[0, :3] if len(motion.object_pose) else palm[0, :3, 3]
    T[:2, 3] = -(T[:2, :2] @ start[:2])
    return T


M = np.diag([-1.0, 1.0, 1.0])
OTHER = {"left": "right", "right": "left"}


def mirror_motion(motion: HandMotion) -> HandMotion:
    """Reflect a motion in the plane x = 0: a left hand becomes a right hand.

    Rotations R become M R M, so the object must be mirrored in its own frame as well.
    """
    pose = motion.object_pose * np.array([-1, 1, 1, 1, -1, -1, 1])
    palm = motion.T_world_palm.copy()
    palm[:, :3, :3] = M @ palm[:, :3, :3] @ M
    palm[:, :3, 3] = palm[:, :3, 3] @ M
    return replace(motion, side=OTHER[motion.side], keypoints_m=motion.keypoints_m @ M, object_pose=pose, T_world_palm=palm)


NONE = -1.0
"""a figure that was not reached"""


@dataclass(frozen=True)
class RetargetOptions:
    """Options of a retargeting."""

    weights: FitWeights
    rules: ClipRules
    keep_tips: float
    """with an object: 1 leaves fingertips where the human ones are, 0 where the scaled finger of the robot ends"""
    max_rate_hz: float
    """faster clips are subsampled to every second, third, ... frame"""
    max_frames: int
    """longer clips are cut"""
    centre: bool
    """rotate and shift the world about z: zero mean yaw; the object (else the palm) starts at x = y = 0"""
    frame_steps: int
    clip_steps: int


def retarget(motion: HandMotion, hand: HandModel, options: RetargetOptions) -> Retargeted:
    """Fit the hand to a clip and judge the fit; the same input gives the same bytes."""
    motion = subsampled(motion, options.max_rate_hz, options.max_frames)
    wrong = clip_rules.check_motion(motion, hand, options.rules)
    if wrong is not None:
        return Retargeted(motion.name, _verdict(motion, hand, wrong), ())
    ours = motion if motion.side == hand.side else mirror_motion(motion)
    reference = fit_hand(ours, hand, options, mirrored=ours is not motion)
    fingers, palm = _fastest(hand, reference)
    wrong = clip_rules.check_fit(reference.error_m, fingers, palm, gantry_overrun(hand, reference.q), options.rules)
    verdict = _verdict(motion, hand, wrong, reference, fingers, palm)
    return Retargeted(motion.name, verdict, () if wrong else (reference,))


def fit_hand(motion: HandMotion, hand: HandModel, options: RetargetOptions, *, mirrored: bool = False) -> HandReference:
    """Fit the hand in every frame of a motion of its own side; gantry joints may exceed their limits, motors never do."""
    which = hand_points(hand)
    goal = scaled_targets(hand, which, motion.keypoints_m, options.keep_tips if len(motion.object_pose) else 0.0)
    problem = RetargetProblem(hand, which, goal, options.weights)
    state = fit_clip(problem, fit_frames(problem, options.frame_steps), motion.rate_hz, options.clip_steps)
    points = problem.points_of(state).reshape(goal.points_m.shape)
    error = np.linalg.norm(points - goal.points_m, axis=-1).mean(axis=(1, 2))
    T = centred_world(motion, state.palm) if options.centre else np.eye(4)
    return _reference(motion, hand, problem, state, T, error, bone_angles(which, points, motion.keypoints_m), mirrored)


def subsampled(motion: HandMotion, max_rate_hz: float, max_frames: int) -> HandMotion:
    """Take every k-th frame, so that the rate is at most max_rate_hz, and the first max_frames of them."""
    step = max(1, int(np.ceil(motion.rate_hz / max_rate_hz - 1e-9)))
    part = slice(0, step * max_frames, step)
    return replace(motion, rate_hz=motion.rate_hz / step, keypoints_m=motion.keypoints_m[part], phase=motion.phase[part],
                   object_pose=motion.object_pose[part], T_world_palm=motion.T_world_palm[part])


def _reference(motion: HandMotion, hand: HandModel, problem: RetargetProblem, state: FitState, T: np.ndarray, error: np.ndarray,
               bones: np.ndarray, mirrored: bool) -> HandReference:
    palm = T @ state.palm
    q = gantry_joints(hand, problem.q(state), palm)
    points = problem.points_of(FitState(palm, state.motors)).reshape(len(q), -1, OF_FINGER, 3)
    return HandReference(
        name=motion.name, hand=hand.name, side=hand.side, mirrored=mirrored, rate_hz=motion.rate_hz, q=q,
        qd=smoothed_rate(q, motion.rate_hz), T_world_palm=palm, palm_twist=twist(palm, motion.rate_hz),
        level_1_m=points[:, :, LEVEL_1].copy(), level_2_m=points[:, :, LEVEL_2].copy(), tips_m=points[:, :, TIP].copy(),
        phase=motion.phase, object_name=motion.object_name, object_pose=_moved(motion.object_pose, T), T_world_source=T,
        error_m=error, bone_error_rad=bones)  # fmt: skip


def _moved(pose: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Transform poses (o, 7) by T, which rotates about z only."""
    half = np.arctan2(T[1, 0], T[0, 0]) / 2
    s, c = np.sin(half), np.cos(half)
    x, y, z, w = pose[:, 3:].T
    turned = np.stack([c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z], axis=1)
    return np.concatenate([pose[:, :3] @ T[:3, :3].T + T[:3, 3], turned], axis=1)


def _fastest(hand: HandModel, reference: HandReference) -> tuple[float, float]:
    """Return the speed of the fastest finger joint in rad/s and of the palm in m/s, between frames, without smoothing."""
    if len(reference.q) < 2:
        return 0.0, 0.0
    fingers = [column for column, k in enumerate(moving_joints(hand.joints)) if hand.joints.role[k] in ("actuated", "coupled")]
    return (float(np.abs(np.diff(reference.q[:, fingers], axis=0)).max() * reference.rate_hz),
            float(np.linalg.norm(np.diff(reference.T_world_palm[:, :3, 3], axis=0), axis=-1).max() * reference.rate_hz))


def _verdict(motion: HandMotion, hand: HandModel, wrong: BrokenRule | None, reference: HandReference | None = None,
             joint_rad_s: float = NONE, palm_m_s: float = NONE) -> RetargetVerdict:
    errors = None if reference is None else reference.error_m
    return RetargetVerdict(
        name=motion.name, source=motion.source, kept=wrong is None, reason=wrong.reason if wrong else "",
        detail=wrong.detail if wrong else "", mirrored=motion.side != hand.side, frames=len(motion.keypoints_m),
        error_mean_m=NONE if errors is None else float(errors.mean()),
        error_p95_m=NONE if errors is None else float(np.percentile(errors, 95)),
        bone_error_rad=NONE if reference is None else float(reference.bone_error_rad.mean()),
        joint_speed_rad_s=joint_rad_s, palm_speed_m_s=palm_m_s)  # fmt: skip


SIGMA_FRAMES = 2.0


def smoothed_rate(values: np.ndarray, rate_hz: float, sigma_frames: float = SIGMA_FRAMES) -> np.ndarray:
    """Differentiate (t, ...) in time, per second, and smooth; 0 for a single frame."""
    if len(values) < 2:
        return np.zeros_like(values)
    return _smooth(np.gradient(values, axis=0) * rate_hz, sigma_frames)


def twist(T: np.ndarray, rate_hz: float, sigma_frames: float = SIGMA_FRAMES) -> np.ndarray:
    """Compute the twist of poses (t, 4, 4): (t, 6), linear then angular velocity in world axes; 0 for a single frame."""
    if len(T) < 2:
        return np.zeros((len(T), 6))
    R = T[:, :3, :3]
    steps = Rotation.from_matrix(R[1:] @ np.swapaxes(R[:-1], 1, 2)).as_rotvec()
    both = np.concatenate([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])
    return np.concatenate([smoothed_rate(T[:, :3, 3], rate_hz, sigma_frames), _smooth(both * rate_hz, sigma_frames)], axis=1)


def _smooth(values: np.ndarray, sigma_frames: float) -> np.ndarray:
    smoothed: np.ndarray = gaussian_filter1d(values, sigma_frames, axis=0, mode="nearest") if sigma_frames > 0 else values
    return smoothed


LOCKED = 1e-4
"""cosine of the pitch below which yaw and roll are the same rotation; the yaw of the previous frame is kept there"""


def has_gantry(hand: HandModel) -> bool:
    """Return true when the first six joints are those of a gantry."""
    return hand.joints.name[: len(STEPS)] == tuple(f"wrist_{step}" for step in STEPS)


def gantry_joints(hand: HandModel, q: np.ndarray, T_world_palm: np.ndarray) -> np.ndarray:
    """Solve the inverse kinematics of the gantry: set the first six columns of q (t, d) so that the palm is at (t, 4, 4).

    Angles are continuous from frame to frame and are not clipped to limits. A hand without a gantry keeps its q: its root is free.
    """
    if not has_gantry(hand):
        return q
    still = forward_kinematics(hand.joints, np.concatenate([np.zeros((len(q), 6)), q[:, 6:]], axis=1))
    T = T_world_palm @ np.linalg.inv(still[:, hand.palm])
    R = T[:, :3, :3]
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1, 1))
    yaw = _held(np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.hypot(R[:, 0, 0], R[:, 1, 0]) < LOCKED)
    cos, sin = np.cos(yaw), np.sin(yaw)
    roll = np.arctan2(sin * R[:, 0, 2] - cos * R[:, 1, 2], cos * R[:, 1, 1] - sin * R[:, 0, 1])
    out = q.copy()
    out[:, :6] = np.stack([*T[:, :3, 3].T, _continuous(yaw), pitch, _continuous(roll)], axis=1)
    return out


def gantry_overrun(hand: HandModel, q: np.ndarray) -> tuple[str, float] | None:
    """Return the gantry joint that exceeds its limits most, and by how much; None when all stay within."""
    if not has_gantry(hand):
        return None
    low, high = joint_limits(hand.joints)[:6].T
    over = np.maximum(low - q[:, :6], q[:, :6] - high).max(axis=0)
    worst = int(over.argmax())
    return (hand.joints.name[moving_joints(hand.joints)[worst]], float(over[worst])) if over[worst] > 0 else None


def _held(angle: np.ndarray, locked: np.ndarray) -> np.ndarray:
    """Hold an angle where it is locked: the last free value before, else the first after; 0 where all are locked."""
    if locked.all():
        return np.zeros_like(angle)
    known = np.flatnonzero(~locked)
    before = np.searchsorted(known, np.arange(len(angle)), side="right") - 1
    held: np.ndarray = angle[known[np.maximum(before, 0)]]
    return held


def _continuous(angle: np.ndarray) -> np.ndarray:
    """Unwrap an angle and shift it by whole turns so that its middle is nearest to 0."""
    out = np.unwrap(angle)
    return out - 2 * np.pi * np.round((out.max() + out.min()) / (4 * np.pi))
