"""A person's hand motion -> what a robot hand is to imitate, or why it cannot (AffordDex, HTI)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.grasping.hand.kinematics import moving
from afford.grasping.motion import rules
from afford.grasping.motion.fit import fit_clip, fit_frames
from afford.grasping.motion.mirror import mirrored
from afford.grasping.motion.place import placed
from afford.grasping.motion.points import LEVEL_1, LEVEL_2, OF_FINGER, TIP, hand_points
from afford.grasping.motion.problem import Problem, State, Weights
from afford.grasping.motion.rules import Broken, Rules
from afford.grasping.motion.signals import speed, twist
from afford.grasping.motion.targets import bone_angles, targets
from afford.grasping.motion.wrist import beyond, on_gantry
from schemas.hand import HandModel, HandMotion, HandReference, Retargeted, RetargetVerdict

NONE = -1.0
"""a figure that was not reached"""


@dataclass(frozen=True)
class Wishes:
    """How a hand is fitted."""

    weights: Weights
    rules: Rules
    keep_tips: float
    """with an object: 1 leaves fingertips where the person has them, 0 where a robot's longer finger of that shape ends"""
    max_rate_hz: float
    """of faster clips every second (third, ...) frame is taken"""
    max_frames: int
    """longer clips are cut"""
    centre: bool
    """turn and shift the world about z: the wrist looks ahead on average, the object (or else the palm) begins at x = y = 0"""
    frame_steps: int
    clip_steps: int


def retarget(motion: HandMotion, hand: HandModel, wishes: Wishes) -> Retargeted:
    """Fit the hand to a clip and judge it; the same input gives the same bytes."""
    motion = thinned(motion, wishes.max_rate_hz, wishes.max_frames)
    wrong = rules.before(motion, hand, wishes.rules)
    if wrong is not None:
        return Retargeted(motion.name, _verdict(motion, hand, wrong), ())
    ours = motion if motion.side == hand.side else mirrored(motion)
    reference = fitted(ours, hand, wishes, mirrored=ours is not motion)
    fingers, palm = _fastest(hand, reference)
    wrong = rules.after(reference.error_m, fingers, palm, beyond(hand, reference.q), wishes.rules)
    verdict = _verdict(motion, hand, wrong, reference, fingers, palm)
    return Retargeted(motion.name, verdict, () if wrong else (reference,))


def fitted(motion: HandMotion, hand: HandModel, wishes: Wishes, *, mirrored: bool = False) -> HandReference:
    """The hand in every frame of a motion of its own side. The gantry may pass its limits, motors never do."""
    which = hand_points(hand)
    goal = targets(hand, which, motion.keypoints_m, wishes.keep_tips if len(motion.object_pose) else 0.0)
    problem = Problem(hand, which, goal, wishes.weights)
    state = fit_clip(problem, fit_frames(problem, wishes.frame_steps), motion.rate_hz, wishes.clip_steps)
    points = problem.points_of(state).reshape(goal.points_m.shape)
    error = np.linalg.norm(points - goal.points_m, axis=-1).mean(axis=(1, 2))
    T = placed(motion, state.palm) if wishes.centre else np.eye(4)
    return _reference(motion, hand, problem, state, T, error, bone_angles(which, points, motion.keypoints_m), mirrored)


def thinned(motion: HandMotion, max_rate_hz: float, max_frames: int) -> HandMotion:
    """Every k-th frame, so that there are no more than max_rate_hz, and the first max_frames of those."""
    step = max(1, int(np.ceil(motion.rate_hz / max_rate_hz - 1e-9)))
    part = slice(0, step * max_frames, step)
    return replace(motion, rate_hz=motion.rate_hz / step, keypoints_m=motion.keypoints_m[part], phase=motion.phase[part],
                   object_pose=motion.object_pose[part], T_world_palm=motion.T_world_palm[part])


def _reference(motion: HandMotion, hand: HandModel, problem: Problem, state: State, T: np.ndarray, error: np.ndarray,
               bones: np.ndarray, mirrored: bool) -> HandReference:
    palm = T @ state.palm
    q = on_gantry(hand, problem.q(state), palm)
    points = problem.points_of(State(palm, state.motors)).reshape(len(q), -1, OF_FINGER, 3)
    return HandReference(
        name=motion.name, hand=hand.name, side=hand.side, mirrored=mirrored, rate_hz=motion.rate_hz, q=q,
        qd=speed(q, motion.rate_hz), T_world_palm=palm, palm_twist=twist(palm, motion.rate_hz),
        level_1_m=points[:, :, LEVEL_1].copy(), level_2_m=points[:, :, LEVEL_2].copy(), tips_m=points[:, :, TIP].copy(),
        phase=motion.phase, object_name=motion.object_name, object_pose=_moved(motion.object_pose, T), T_world_source=T,
        error_m=error, bone_error_rad=bones)  # fmt: skip


def _moved(pose: np.ndarray, T: np.ndarray) -> np.ndarray:
    """(o, 7) poses in another world; T turns about z only."""
    half = np.arctan2(T[1, 0], T[0, 0]) / 2
    s, c = np.sin(half), np.cos(half)
    x, y, z, w = pose[:, 3:].T
    turned = np.stack([c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z], axis=1)
    return np.concatenate([pose[:, :3] @ T[:3, :3].T + T[:3, 3], turned], axis=1)


def _fastest(hand: HandModel, reference: HandReference) -> tuple[float, float]:
    """Fastest finger joint in rad/s and fastest palm in m/s, frame by frame, not smoothed."""
    if len(reference.q) < 2:
        return 0.0, 0.0
    fingers = [column for column, k in enumerate(moving(hand.joints)) if hand.joints.role[k] in ("actuated", "coupled")]
    return (float(np.abs(np.diff(reference.q[:, fingers], axis=0)).max() * reference.rate_hz),
            float(np.linalg.norm(np.diff(reference.T_world_palm[:, :3, 3], axis=0), axis=-1).max() * reference.rate_hz))


def _verdict(motion: HandMotion, hand: HandModel, wrong: Broken | None, reference: HandReference | None = None,
             joint_rad_s: float = NONE, palm_m_s: float = NONE) -> RetargetVerdict:
    errors = None if reference is None else reference.error_m
    return RetargetVerdict(
        name=motion.name, source=motion.source, kept=wrong is None, reason=wrong.reason if wrong else "",
        detail=wrong.detail if wrong else "", mirrored=motion.side != hand.side, frames=len(motion.keypoints_m),
        error_mean_m=NONE if errors is None else float(errors.mean()),
        error_p95_m=NONE if errors is None else float(np.percentile(errors, 95)),
        bone_error_rad=NONE if reference is None else float(reference.bone_error_rad.mean()),
        joint_speed_rad_s=joint_rad_s, palm_speed_m_s=palm_m_s)  # fmt: skip
