"""`afford/Settle-v0`: gymnasium environment in which objects are dropped on a table and come to rest.

Action (2,): push of the table along x and y, -1..1 (zero lets the objects settle). Observation (n, 7): per body x, y, z in
metres, then four leading numbers of the first two columns of its rotation matrix. Reward: minus the mean speed, at least -1. An
episode terminates when every body is at rest and is truncated after `max_steps`. `rest_poses` runs one episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from scipy.spatial.transform import Rotation

from afford.common.bullet import World

SUBSTEPS = 12
REST_SPEED = 0.02
"""Speed in metres per second below which a body counts as at rest."""
CUBE = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.03, 0.03) for z in (0.0, 0.06)])


class Settle(gymnasium.Env):
    """Environment of bodies (convex hulls of (n, 3) vertex arrays) that fall from random poses onto a table."""

    metadata = {"render_modes": []}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, shapes: Sequence[np.ndarray] = (CUBE, CUBE), spread_m: float = 0.12, max_steps: int = 60) -> None:
        self.shapes, self.spread_m, self.max_steps = tuple(shapes), spread_m, max_steps
        self.observation_space = spaces.Box(-5.0, 5.0, (len(self.shapes), 7), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._world: World | None = None
        self._bodies: list[int] = []
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Drop all bodies from new random poses. The same seed gives the same fall."""
        super().reset(seed=seed)
        self.close()
        self._world, self._steps = World(), 0
        self._bodies = [self._world.add(shape, self._drop(k)) for k, shape in enumerate(self.shapes)]
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate SUBSTEPS / 240 seconds under the push."""
        world = self._running()
        world.pull((float(action[0]), float(action[1])))
        world.step(SUBSTEPS)
        self._steps += 1
        speeds = [world.speed(body) for body in self._bodies]
        rest = self._steps > 2 and max(speeds) < REST_SPEED
        return self._observe(), -min(float(np.mean(speeds)), 1.0), rest, self._steps >= self.max_steps, {"at_rest": rest}

    def poses(self) -> list[np.ndarray]:
        """Return T_world_body (4, 4) of every body."""
        world = self._running()
        return [world.pose(body) for body in self._bodies]

    def close(self) -> None:
        """Release the physics engine."""
        if self._world is not None:
            self._world.close()
            self._world = None

    def _running(self) -> World:
        if self._world is None:
            raise RuntimeError("Settle: call reset before step or poses")
        return self._world

    def _drop(self, index: int) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3] = Rotation.random(random_state=self.np_random).as_matrix()
        reach = float(np.abs(self.shapes[index]).max())
        T[:3, 3] = [*self.np_random.uniform(-self.spread_m, self.spread_m, 2), 0.05 + reach + 0.16 * index]
        return T

    def _observe(self) -> np.ndarray:
        rows = [np.concatenate([T[:3, 3], T[:3, :2].reshape(-1)[:4]]) for T in self.poses()]
        return np.clip(np.array(rows), -5, 5).astype(np.float32)


gymnasium.register(id="afford/Settle-v0", entry_point="afford.synthetic.kitchens.settle_env:Settle")


def rest_poses(shapes: Sequence[np.ndarray], seed: int, spread_m: float = 0.12) -> list[np.ndarray]:
    """Return T_table_body (4, 4) of bodies that were dropped near the origin of a table and settled."""
    env = Settle(shapes, spread_m, max_steps=90)
    env.reset(seed=seed)
    done = False
    while not done:
        _, _, at_rest, late, _ = env.step(np.zeros(2, np.float32))
        done = at_rest or late
    poses = env.poses()
    env.close()
    return poses
