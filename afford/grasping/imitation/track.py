"""How hands are beside what they follow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import commanded_columns, forward_kinematics, jacobian, moving_joints, points_on_links
from afford.grasping.imitation.imitation import Tracking
from afford.grasping.sim.engine import State
from schemas.hand import HandModel

LEVELS = ("level_1_m", "level_2_m", "tips_m")
FIELDS = ("T_world_palm", "palm_twist", "qd", *LEVELS[:2])
"""what `compare` wants to know of references"""


class Tracker:
    """One kind of hand."""

    def __init__(self, hand: HandModel) -> None:
        self.hand = hand
        self._of_motor = commanded_columns(hand.joints)

    def levels(self, T: np.ndarray) -> dict[str, np.ndarray]:
        """(n, l, 4, 4) links -> level -> (n, f, 3) world."""
        fingers = self.hand.fingers
        zero = np.zeros((len(fingers.name), 3))
        return {"level_1_m": points_on_links(T, fingers.base_link, zero),
                "level_2_m": points_on_links(T, fingers.middle_link, zero)}  # fmt: skip

    def compare(self, state: State, wanted: Mapping[str, np.ndarray]) -> Tracking:
        """States of n hands beside FIELDS of their references, (n, ...) each."""
        T = forward_kinematics(self.hand.joints, state.q)
        palm = wanted["T_world_palm"]
        turn = Rotation.from_quat(state.palm[:, 3:]) * Rotation.from_matrix(palm[:, :3, :3]).inv()
        twist = self.palm_velocity(T, state) - wanted["palm_twist"]
        power = np.abs(state.torque * state.qd[:, self._of_motor])
        level_1, level_2 = (np.linalg.norm(places - wanted[name], axis=2) for name, places in self.levels(T).items())
        return Tracking(
            level_1_m=level_1, level_2_m=level_2, wrist_m=np.linalg.norm(state.palm[:, :3] - palm[:, :3, 3], axis=1),
            wrist_rad=turn.magnitude(), linear_m_s=twist[:, :3], angular_rad_s=twist[:, 3:],
            joints_rad_s=(state.qd - wanted["qd"])[:, 6:],
            power_w=power[:, 6:].sum(axis=1), wrist_power_w=power[:, :6].sum(axis=1))  # fmt: skip

    def palm_velocity(self, T: np.ndarray, state: State) -> np.ndarray:
        """(n, 6) linear and angular; the gantry's joints alone move the palm."""
        hand = self.hand
        linear = np.einsum("nkid,nd->nki", jacobian(hand.joints, T, np.array([hand.palm]), np.zeros((1, 3))), state.qd)[:, 0]
        wrist = [k for k, role in enumerate(hand.joints.role) if role == "wrist" and hand.joints.kind[k] == "revolute"]
        axes = np.einsum("nkij,kj->nki", T[:, hand.joints.child[wrist], :3, :3], hand.joints.axis[wrist])
        columns = np.searchsorted(moving_joints(hand.joints), wrist)
        return np.concatenate([linear, np.einsum("nki,nk->ni", axes, state.qd[:, columns])], axis=1)
