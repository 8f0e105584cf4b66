"""Tracking of reference motion: reference clips, tracking errors of robot hands, imitation rewards (AffordDex, HTI), and failure.

The reward `paper` has squared distances of 22 keypoints of two levels (keypoints.py), and a smoothness term, which is the power of
all motors. The reward `code` is that of the released code: mean distances that are not squared, and also the wrist's pose and the
speeds. Errors of tracking, in rewards, failure and tables alike, are those of one joint per finger and level. Trackers, clips and
rewards also compute with tensors (env/arrays.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from afford.common.arrays import mapped, namespace
from afford.grasping.env.rotations import angle_between
from afford.grasping.hand.kinematics import (
    commanded_columns,
    forward_kinematics,
    jacobian,
    joint_constants,
    moving_joints,
    points_on_links,
)
from afford.grasping.imitation.keypoints import keypoint_links, keypoints_of_joints
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


def _exp(x: np.ndarray) -> np.ndarray:
    found: np.ndarray = namespace(x).exp(x)
    return found


TERMS: Mapping[str, Term] = {
    "fingers": Term("sum over 22 keypoints of exp(-50 d^2) of level 1 and exp(-40 d^2) of level 2",
                    lambda t: _exp(-50 * t.keypoints_1_m**2).sum(axis=1) + _exp(-40 * t.keypoints_2_m**2).sum(axis=1)),
    "smooth": Term("W, minus the sum of |torque x speed| of all motors", lambda t: -(t.power_w + t.wrist_power_w)),
    "level_1": Term("exp(-50 x mean distance) of level 1", lambda t: _exp(-50 * t.level_1_m.mean(axis=1))),
    "level_2": Term("exp(-40 x mean distance) of level 2", lambda t: _exp(-40 * t.level_2_m.mean(axis=1))),
    "wrist_place": Term("exp(-40 d) of the palm's place", lambda t: _exp(-40 * t.wrist_m)),
    "wrist_turn": Term("exp(-angle) of the palm's rotation", lambda t: _exp(-t.wrist_rad)),
    "wrist_linear": Term("exp(-mean |difference|) of the palm's velocity", lambda t: _exp(-abs(t.linear_m_s).mean(axis=1))),
    "wrist_angular": Term("the same of its angular velocity", lambda t: _exp(-abs(t.angular_rad_s).mean(axis=1))),
    "joint_speeds": Term("the same of the speeds of fingers' joints", lambda t: _exp(-abs(t.joints_rad_s).mean(axis=1))),
    "calm": Term("exp(-10 W) of the fingers' motors", lambda t: _exp(-10 * t.power_w)),
    "wrist_calm": Term("exp(-2 W) of the wrist's", lambda t: _exp(-2 * t.wrist_power_w)),
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
    xp = namespace(running_s)
    far = xp.maximum(tracking.level_1_m.mean(axis=1), tracking.level_2_m.mean(axis=1)) > tolerance
    linear, angular, joints = (xp.amax(abs(speed), axis=1)
                               for speed in (tracking.linear_m_s, tracking.angular_rad_s, tracking.joints_rad_s))  # fmt: skip
    fast = (linear > MAX_M_S) | (angular > MAX_RAD_S) | (joints > MAX_RAD_S)
    found: np.ndarray = (far | fast) & (running_s > PATIENCE_S)
    return found


LEVELS = ("level_1_m", "level_2_m", "tips_m")
KEYPOINTS = "keypoints_m"
"""name of the keypoints (t, k, 3) of a reference, which are computed from its joints"""
FIELDS = ("T_world_palm", "palm_twist", "qd", *LEVELS[:2], KEYPOINTS)
"""fields of a reference that `Tracker.compare` needs"""


class Tracker:
    """Computes tracking errors of one model of robot hand."""

    def __init__(self, hand: HandModel, own: Callable[[np.ndarray], np.ndarray] = np.asarray) -> None:
        """Compute the constants of the hand; `own` converts them (env/arrays.py)."""
        joints, (links, self._level_1) = hand.joints, keypoint_links(hand)
        wrist = [k for k, role in enumerate(joints.role) if role == "wrist" and joints.kind[k] == "revolute"]
        self._joints, self._of_motor = mapped(joint_constants(joints), own), own(commanded_columns(joints))
        self._palm, self._keypoints, self._zero = own(np.array([hand.palm])), own(links), own(np.zeros((len(links), 3)))
        self._levels = {"level_1_m": own(hand.fingers.base_link), "level_2_m": own(hand.fingers.middle_link)}
        self._wrist_link, self._wrist_axis = own(joints.child[wrist]), own(joints.axis[wrist])
        self._of_wrist = own(np.searchsorted(moving_joints(joints), wrist))

    def levels(self, T: np.ndarray) -> dict[str, np.ndarray]:
        """Poses of links (n, l, 4, 4) -> level -> joints of the fingers (n, f, 3), world."""
        return {name: points_on_links(T, links, self._zero[: len(links)]) for name, links in self._levels.items()}

    def compare(self, state: State, wanted: Mapping[str, np.ndarray]) -> Tracking:
        """Compare states of n hands with FIELDS of their references, (n, ...) each."""
        T, norm = forward_kinematics(self._joints, state.q), namespace(state.q).linalg.norm
        palm = wanted["T_world_palm"]
        twist = self.palm_velocity(T, state) - wanted["palm_twist"]
        power = abs(state.torque * state.qd[:, self._of_motor])
        level_1, level_2 = (norm(places - wanted[name], axis=2) for name, places in self.levels(T).items())
        points = norm(points_on_links(T, self._keypoints, self._zero) - wanted[KEYPOINTS], axis=2)
        return Tracking(
            level_1_m=level_1, level_2_m=level_2,
            keypoints_1_m=points[:, : self._level_1], keypoints_2_m=points[:, self._level_1 :],
            wrist_m=norm(state.palm[:, :3] - palm[:, :3, 3], axis=1),
            wrist_rad=angle_between(state.palm[:, 3:], palm[:, :3, :3]), linear_m_s=twist[:, :3], angular_rad_s=twist[:, 3:],
            joints_rad_s=(state.qd - wanted["qd"])[:, 6:],
            power_w=power[:, 6:].sum(axis=1), wrist_power_w=power[:, :6].sum(axis=1))  # fmt: skip

    def palm_velocity(self, T: np.ndarray, state: State) -> np.ndarray:
        """(n, 6) linear and angular velocity of the palm, which only the gantry's joints move."""
        xp, speed = namespace(T), state.qd
        linear = xp.einsum("nkid,nd->nki", jacobian(self._joints, T, self._palm, self._zero[:1]), speed)[:, 0]
        axes = xp.einsum("nkij,kj->nki", T[:, self._wrist_link, :3, :3], self._wrist_axis)
        found: np.ndarray = xp.concatenate([linear, xp.einsum("nki,nk->ni", axes, speed[:, self._of_wrist])], axis=1)
        return found


class ReferenceClips:
    """Reference clips, read at control steps by the nearest frame."""

    def __init__(self, hand: HandModel, references: Sequence[HandReference],
                 own: Callable[[np.ndarray], np.ndarray] = np.asarray) -> None:  # fmt: skip
        """Check the clips; `own` converts what is read (env/arrays.py).

        ValueError without clips, for clips of another hand, or clips that are too short.
        """
        if not references:
            raise ValueError("references: expected one or more clips")
        for one in references:
            _check(hand, one)
        self.references, self._own = tuple(references), own
        self._keypoints = [keypoints_of_joints(hand, one.q) for one in references]
        self.steps = np.array([int((len(r.q) - 1) / r.rate_hz / CONTROL_S + 1e-9) + 1 for r in references])
        self._frames = [[min(round(step * CONTROL_S * one.rate_hz), len(one.q) - 1) for step in range(self.steps.max() + 2)]
                        for one in references]  # fmt: skip
        self._tables: dict[str, np.ndarray] = {}

    def at(self, name: str, clip: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(n, ...) field `name` of clips `clip` (n,) at control steps (n,); the last frame after the end of a clip."""
        if name not in self._tables:
            rows = self._keypoints if name == KEYPOINTS else [getattr(one, name) for one in self.references]
            self._tables[name] = self._own(np.stack([row[frames] for row, frames in zip(rows, self._frames, strict=True)]))
        found: np.ndarray = self._tables[name][clip, step.clip(max=self.steps.max() + 1)]
        return found


def _check(hand: HandModel, one: HandReference) -> None:
    d = len(moving_joints(hand.joints))
    if one.hand != hand.name or one.q.shape[1] != d:
        raise ValueError(f"reference {one.name}: expected {d} joints of the hand {hand.name}, got {one.q.shape[1]} of {one.hand}")
    if len(one.q) <= 2 * CONTROL_S * one.rate_hz:
        raise ValueError(f"reference {one.name}: expected more than {2 * CONTROL_S:g} s, got {len(one.q)} frames")
