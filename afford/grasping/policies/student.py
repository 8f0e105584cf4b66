"""A student among n grasps: it looks, and acts in the frame of its own start. It touches a world only through what senses say
(`sensed`), what cameras show (`shoot`) and where N_t lies.

N_t comes from the stage before in the frame of the object. `first_look`: it stays where it lay in the world when the episode began,
which a robot knows from having looked at the scene once. `tracked`: it moves with the object's true pose, the paper's way.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch

from afford.grasping.env import act
from afford.grasping.env.core import Grasping
from afford.grasping.policies.cameras import Rig, shoot
from afford.grasping.policies.depth_noise import DepthNoise, drawn, noisy
from afford.grasping.policies.proprioception import Proprioception, Start, body_of, sensed
from afford.grasping.policies.shapes import body_shape, hand_shape
from afford.grasping.policies.sight import Eyes, Seen, see
from afford.grasping.rl.cloud_policy import CloudPolicy

N_SOURCES = ("first_look", "tracked")


@dataclass(frozen=True)
class Senses:
    """All that a student sees by. ValueError for what cannot be."""

    rig: Rig = field(default_factory=Rig)
    eyes: Eyes = field(default_factory=Eyes)
    n_t: str = "first_look"
    """first_look or tracked"""

    def __post_init__(self) -> None:
        if self.n_t not in N_SOURCES:
            raise ValueError(f"n_t: expected {' or '.join(N_SOURCES)}, got {self.n_t!r}")


class Sight:
    """Cameras and senses in n worlds. It must look, or act, at the beginning of every episode."""

    def __init__(self, core: Grasping, senses: Senses, seed: int = 0) -> None:
        """`seed` of the noise of depth, which is there where worlds are randomised."""
        n = len(core.tasks)
        self.core, self.senses = core, senses
        self.cameras, self.hand = senses.rig.cameras(), hand_shape(core.scenery.hand)
        shapes = {id(one.body): body_shape(one.body) for one in core.tasks}
        self.bodies = [shapes[id(one.body)] for one in core.tasks]
        self.robot = body_of(core.scenery, core.rates[:, 0])
        self.noise = [drawn(core.config.seed + k) if core.config.randomise else DepthNoise() for k in range(n)]
        self.start, self._N = Start(np.zeros((n, 3)), np.zeros(n)), core.scenery.N_object.copy()
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Noise anew."""
        self._rng = np.random.default_rng([seed, 3])

    def look(self) -> Seen:
        """Now."""
        core, state, own = self.core, self.core.state(), sensed(self.core.now(), self.robot.rates)
        self._remember(own)
        images = noisy(shoot(self.cameras, self.hand, self.bodies, state.q, state.body), self.noise, self._rng)
        N = core.scenery.negative_points(state) if self.senses.n_t == "tracked" else self._N
        return see(images, own, N, core.scenery.any_negative, self.cameras, self.robot, self.start, self.senses.eyes)

    def own(self, action: np.ndarray) -> np.ndarray:
        """(n, m) actions as `core.step` takes them -> in the frame of the start, where they may be beyond -1..1."""
        return self.robot.own(act.turned(action * self.robot.rates, self.core.now().episode.yaw), self.start)

    def given(self, action: np.ndarray) -> np.ndarray:
        """(n, m) actions in the frame of the start -> as `core.step` takes them: the same moves of the hand in the world."""
        moves = self.robot.world(action, self.start)
        found: np.ndarray = (act.turned(moves, -self.core.now().episode.yaw) / self.robot.rates).clip(-1, 1)
        return found

    def _remember(self, own: Proprioception) -> None:
        """Where hands were and N_t lay, of episodes that begin now."""
        fresh = np.flatnonzero(self.core.steps_done() == 0)
        begun = self.robot.start(own)
        self.start.origin[fresh], self.start.yaw[fresh] = begun.origin[fresh], begun.yaw[fresh]
        self._N[fresh] = self.core.scenery.negative_points(self.core.state())[fresh]


class Student:
    """A trained student at work: an Actor (evaluate.py)."""

    def __init__(self, model: CloudPolicy, senses: Senses) -> None:
        self.model, self.senses = model.eval(), senses
        self._sight: Sight | None = None

    @torch.no_grad()
    def act(self, now: Grasping) -> np.ndarray:
        """(n, m) as `step` takes them."""
        if self._sight is None or self._sight.core is not now:
            self._sight = Sight(now, self.senses)
        chosen = self.model(*(torch.from_numpy(part) for part in self._sight.look()))
        return self._sight.given(chosen.numpy().astype(np.float64))
