"""Tracking of reference motion: reference clips, tracking errors of robot hands, imitation rewards (AffordDex, HTI), and failure.

The reward `paper` has squared distances of 22 keypoints of two levels (keypoints.py), and a smoothness term, which is the power of
all motors. The reward `code` is that of the released code: mean distances that are not squared, and also the wrist's pose and the
speeds. Errors of tracking, in rewards, failure and tables alike, are those of one joint per finger and level.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import commanded_columns, forward_kinematics, jacobian, moving_joints, points_on_links
from afford.grasping.imitation.keypoints import keypoint_links, keypoints_of_joints, keypoints_of_links
from afford.grasping.sim.engine import CONTROL_S, State
from schemas.hand import HandModel, HandReference

FINAL_TOLERANCE_M = 0.15
"""largest mean error of a level at the end of the paper's trainings"""
MAX_M_S, MAX_RAD_S = 100.0, 200.0
"""speeds beyond which an episode has failed, since the physics diverges"""
PATIENCE_S = 50 / 60
"""time before which an episode cannot fail"""


@dataclass(frozen=True, eq=False)
class Tracking:
    """Tracking errors of n hands with f fingers against their references."""

    level_1_m: np.ndarray
    """(n, f) distances of the joints where fingers leave the palm"""
    level_2_m: np.ndarray
    """(n, f) distances of the joints one phalanx further"""
    keypoints_1_m: np.ndarray
    """(n, 10) distances of the keypoints of level 1"""
    keypoints_2_m: np.ndarray
    """(n, 12) distances of the keypoints of level 2"""
    wrist_m: np.ndarray
    """(n,) distance of the palm"""
    wrist_rad: np.ndarray
    """(n,) angle between the rotations of the palm"""
    linear_m_s: np.ndarray
    """(n, 3) velocity of the palm minus that of the reference"""
    angular_rad_s: np.ndarray
    """(n, 3) the same for its angular velocity"""
    joints_rad_s: np.ndarray
    """(n, k) speeds of finger joints minus those of the reference"""
    power_w: np.ndarray
    """(n,) sum of |torque x speed| of the fingers' motors"""
    wrist_power_w: np.ndarray
    """(n,) the same for the wrist's motors"""


class Term(NamedTuple):
    """Named reward term."""

    doc: str
    of: Callable[[Tracking], np.ndarray]
    """-> (n,) before its weight"""


TERMS: Mapping[str, Term] = {
    "fingers": Term("sum over 22 keypoints of exp(-50 d^2) of level 1 and exp(-40 d^2) of level 2",
                    lambda t: np.exp(-50 * t.keypoints_1_m**2).sum(axis=1) + np.exp(-40 * t.keypoints_2_m**2).sum(axis=1)),
    "smooth": Term("W, minus the sum of |torque x speed| of all motors", lambda t: -(t.power_w + t.wrist_power_w)),
    "level_1": Term("exp(-50 x mean distance) of level 1", lambda t: np.exp(-50 * t.level_1_m.mean(axis=1))),
    "level_2": Term("exp(-40 x mean distance) of level 2", lambda t: np.exp(-40 * t.level_2_m.mean(axis=1))),
    "wrist_place": Term("exp(-40 d) of the palm's place", lambda t: np.exp(-40 * t.wrist_m)),
    "wrist_turn": Term("exp(-angle) of the palm's rotation", lambda t: np.exp(-t.wrist_rad)),
    "wrist_linear": Term("exp(-mean |difference|) of the palm's velocity", lambda t: np.exp(-np.abs(t.linear_m_s).mean(axis=1))),
    "wrist_angular": Term("the same of its angular velocity", lambda t: np.exp(-np.abs(t.angular_rad_s).mean(axis=1))),
    "joint_speeds": Term("the same of the speeds of fingers' joints", lambda t: np.exp(-np.abs(t.joints_rad_s).mean(axis=1))),
    "calm": Term("exp(-10 W) of the fingers' motors", lambda t: np.exp(-10 * t.power_w)),
    "wrist_calm": Term("exp(-2 W) of the wrist's", lambda t: np.exp(-2 * t.wrist_power_w)),
}  # fmt: skip

REWARDS: Mapping[str, Mapping[str, float]] = {
    "paper": {"fingers": 0.8, "smooth": 0.05},
    "code": {"level_1": 0.6, "level_2": 0.8, "wrist_place": 0.1, "wrist_turn": 0.6, "wrist_linear": 0.1, "wrist_angular": 0.05,
             "joint_speeds": 0.1, "calm": 0.05, "wrist_calm": 0.05},
}  # fmt: skip


def imitation_rewards(name: str, tracking: Tracking) -> dict[str, np.ndarray]:
    """Compute every term (n,) times its weight; the sum of all is the reward. ValueError for an unknown set."""
    if name not in REWARDS:
        raise ValueError(f"reward: expected one of {', '.join(sorted(REWARDS))}, got {name!r}")
    return {term: weight * TERMS[term].of(tracking) for term, weight in REWARDS[name].items()}


def tracking_failed(tracking: Tracking, tolerance: float, running_s: np.ndarray) -> np.ndarray:
    """(n,) bool, an episode is beyond the tolerance, or faster than the physics allows, after PATIENCE_S of `running_s` (n,)."""
    far = np.maximum(tracking.level_1_m.mean(axis=1), tracking.level_2_m.mean(axis=1)) > tolerance
    fast = (np.abs(tracking.linear_m_s).max(axis=1) > MAX_M_S) | (np.abs(tracking.angular_rad_s).max(axis=1) > MAX_RAD_S)
    return (far | fast | (np.abs(tracking.joints_rad_s).max(axis=1) > MAX_RAD_S)) & (running_s > PATIENCE_S)


LEVELS = ("level_1_m", "level_2_m", "tips_m")
KEYPOINTS = "keypoints_m"
"""name of the keypoints (t, k, 3) of a reference, which are computed from its joints"""
FIELDS = ("T_world_palm", "palm_twist", "qd", *LEVELS[:2], KEYPOINTS)
"""fields of a reference that `Tracker.compare` needs"""


class Tracker:
    """Computes tracking errors of one model of robot hand."""

    def __init__(self, hand: HandModel) -> None:
        self.hand = hand
        self._of_motor, (_, self._level_1) = commanded_columns(hand.joints), keypoint_links(hand)

    def levels(self, T: np.ndarray) -> dict[str, np.ndarray]:
        """Poses of links (n, l, 4, 4) -> level -> joints of the fingers (n, f, 3), world."""
        fingers = self.hand.fingers
        zero = np.zeros((len(fingers.name), 3))
        return {"level_1_m": points_on_links(T, fingers.base_link, zero),
                "level_2_m": points_on_links(T, fingers.middle_link, zero)}  # fmt: skip

    def compare(self, state: State, wanted: Mapping[str, np.ndarray]) -> Tracking:
        """Compare states of n hands with FIELDS of their references, (n, ...) each."""
        T = forward_kinematics(self.hand.joints, state.q)
        palm = wanted["T_world_palm"]
        turn = Rotation.from_quat(state.palm[:, 3:]) * Rotation.from_matrix(palm[:, :3, :3]).inv()
        twist = self.palm_velocity(T, state) - wanted["palm_twist"]
        power = np.abs(state.torque * state.qd[:, self._of_motor])
        level_1, level_2 = (np.linalg.norm(places - wanted[name], axis=2) for name, places in self.levels(T).items())
        points = np.linalg.norm(keypoints_of_links(self.hand, T) - wanted[KEYPOINTS], axis=2)
        return Tracking(
            level_1_m=level_1, level_2_m=level_2,
            keypoints_1_m=points[:, : self._level_1], keypoints_2_m=points[:, self._level_1 :],
            wrist_m=np.linalg.norm(state.palm[:, :3] - palm[:, :3, 3], axis=1),
            wrist_rad=turn.magnitude(), linear_m_s=twist[:, :3], angular_rad_s=twist[:, 3:],
            joints_rad_s=(state.qd - wanted["qd"])[:, 6:],
            power_w=power[:, 6:].sum(axis=1), wrist_power_w=power[:, :6].sum(axis=1))  # fmt: skip

    def palm_velocity(self, T: np.ndarray, state: State) -> np.ndarray:
        """(n, 6) linear and angular velocity of the palm, which only the gantry's joints move."""
        hand = self.hand
        linear = np.einsum("nkid,nd->nki", jacobian(hand.joints, T, np.array([hand.palm]), np.zeros((1, 3))), state.qd)[:, 0]
        wrist = [k for k, role in enumerate(hand.joints.role) if role == "wrist" and hand.joints.kind[k] == "revolute"]
        axes = np.einsum("nkij,kj->nki", T[:, hand.joints.child[wrist], :3, :3], hand.joints.axis[wrist])
        columns = np.searchsorted(moving_joints(hand.joints), wrist)
        return np.concatenate([linear, np.einsum("nki,nk->ni", axes, state.qd[:, columns])], axis=1)


class ReferenceClips:
    """Reference clips, read at control steps by the nearest frame."""

    def __init__(self, hand: HandModel, references: Sequence[HandReference]) -> None:
        """Check the clips. ValueError without clips, for clips of another hand, or clips that are too short."""
        if not references:
            raise ValueError("references: expected one or more clips")
        for one in references:
            _check(hand, one)
        self.references = tuple(references)
        self._keypoints = [keypoints_of_joints(hand, one.q) for one in references]
        self.steps = np.array([int((len(r.q) - 1) / r.rate_hz / CONTROL_S + 1e-9) + 1 for r in references])

    def at(self, name: str, clip: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(n, ...) field `name` of clips `clip` (n,) at control steps (n,); the last frame after the end of a clip."""
        return np.stack([self._row(name, k, s) for k, s in zip(clip.tolist(), step.tolist(), strict=True)])

    def _row(self, name: str, clip: int, step: int) -> np.ndarray:
        one = self.references[clip]
        rows: np.ndarray = self._keypoints[clip] if name == KEYPOINTS else getattr(one, name)
        return rows[min(round(step * CONTROL_S * one.rate_hz), len(rows) - 1)]


def _check(hand: HandModel, one: HandReference) -> None:
    d = len(moving_joints(hand.joints))
    if one.hand != hand.name or one.q.shape[1] != d:
        raise ValueError(f"reference {one.name}: expected {d} joints of the hand {hand.name}, got {one.q.shape[1]} of {one.hand}")
    if len(one.q) <= 2 * CONTROL_S * one.rate_hz:
        raise ValueError(f"reference {one.name}: expected more than {2 * CONTROL_S:g} s, got {len(one.q)} frames")
