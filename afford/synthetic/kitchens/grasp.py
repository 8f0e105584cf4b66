"""The fingers of an arm over time: open when it comes, closed on the very object that it holds."""

from __future__ import annotations

import numpy as np

from afford.render.mesh import merge
from afford.synthetic.kitchens.play import Arm, Touch
from afford.synthetic.people.hand_grasp import close_on, distance_to, opening, posture


class Fingers:
    """Joint angles (20,) of the hand of an arm at any time."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self._closed = [closed_on(touch) for touch in arm.touches]

    def at(self, time: float) -> np.ndarray:
        """Joint angles in radians at a play time."""
        if not self.arm.touches:
            return posture("relaxed")
        weights = np.array([_nearness(touch, time) for touch in self.arm.touches])
        weights /= weights.sum()
        amount = float(self.arm.closed.at(time)[0])
        opened = np.array([opening(touch.grip.kind) for touch in self.arm.touches])
        return weights @ (opened + amount * (np.array(self._closed) - opened))


def closed_on(touch: Touch) -> np.ndarray:
    """The angles (20,) at which the fingers rest on what is held."""
    grip, model = touch.grip, touch.thing.model
    shapes = [part.mesh for part in model.parts]
    return close_on(grip.kind, distance_to(merge(*shapes), np.linalg.inv(grip.T_obj_palm), grip.side))


def _nearness(touch: Touch, time: float) -> float:
    gap = max(touch.start - time, time - touch.stop, 0.0)
    return float(np.exp(-((gap / 6.0) ** 2))) + 1e-6
