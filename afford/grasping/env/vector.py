"""Many worlds as one environment of gymnasium, and as what PPO learns in.

An episode that ends begins anew in the same step: the observation is then the first of the next, and `final_obs` the last of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from afford.grasping.env.observe import LIMIT
from afford.grasping.env.single import Core
from afford.grasping.rl.ppo import Moved


class Many(VectorEnv):
    """A core of n worlds."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, core: Core, num_envs: int) -> None:
        self._core, self.num_envs = core, num_envs
        self.single_observation_space = spaces.Box(-LIMIT, LIMIT, (core.width,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (core.motors,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs: list[np.random.Generator] = []

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:  # fmt: skip
        """Begin everywhere; a number seeds world k with seed + k, and without one the generators go on."""
        if seed is not None or not self._rngs:
            seeds = [None] * self.num_envs if seed is None else _seeds(seed, self.num_envs)
            self._rngs = [np.random.default_rng(one) for one in seeds]
        self._core.reset(range(self.num_envs), self._rngs)
        return self._core.observe(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """A twentieth of a second; infos have `reward/...` (n,), and where episodes ended `final_obs` and `final_info`."""
        out = self._core.step(actions, self._rngs)
        observation, ended = self._core.observe(), out.terminated | out.truncated
        infos: dict[str, Any] = {"success": out.success, **{f"reward/{name}": term for name, term in out.terms.items()}}
        if ended.any():
            infos |= _final(observation, ended, self._core.report())
            self._core.reset(np.flatnonzero(ended).tolist(), self._rngs)
            observation = self._core.observe()
        return observation, out.reward, out.terminated, out.truncated, infos

    def save(self) -> Any:
        """Everything that the next steps depend on."""
        return self._core.save(), [rng.bit_generator.state for rng in self._rngs]

    def restore(self, token: Any) -> np.ndarray:
        """Back to what was saved; the observation (n, d)."""
        self._core.restore(token[0])
        for rng, state in zip(self._rngs, token[1], strict=True):
            rng.bit_generator.state = state
        return self._core.observe()

    def close_extras(self, **kwargs: Any) -> None:
        """Give the engines back."""
        self._core.close()


class Learning:
    """Many worlds as afford.grasping.rl.ppo.Environments; rewards are scaled, notes have each term and the report of what ended."""

    def __init__(self, envs: Many, seed: int, scale: float = 0.1) -> None:
        self.envs, self.seed, self.scale = envs, seed, scale

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        return self.envs.reset(seed=self.seed)[0]

    def step(self, action: np.ndarray) -> Moved:
        """Act (n, 24)."""
        observation, reward, terminated, truncated, infos = self.envs.step(action)
        notes = {name: float(term.mean()) for name, term in infos.items() if name.startswith("reward/")}
        reached = observation
        if "final_obs" in infos:
            ended = infos["_final_obs"]
            reached = observation.copy()
            reached[ended] = np.stack(list(infos["final_obs"][ended]))
            notes |= means(infos["final_info"]["report"], ended)
        return Moved(observation, reached, self.scale * reward, terminated, truncated, notes)


def means(report: dict[str, np.ndarray], ended: np.ndarray) -> dict[str, float]:
    """Of every figure over the chosen episodes, such as ended; those that say nothing (NaN) are left out."""
    kept = {name: figure[ended & ~np.isnan(figure)] for name, figure in report.items()}
    return {name: float(figure.mean()) for name, figure in kept.items() if len(figure)}


def _final(observation: np.ndarray, ended: np.ndarray, report: dict[str, np.ndarray]) -> dict[str, Any]:
    last = np.full(len(ended), None, dtype=object)
    for k in np.flatnonzero(ended):
        last[k] = observation[k]
    return {"final_obs": last, "_final_obs": ended, "final_info": {"report": report, "_report": ended}, "_final_info": ended}


def _seeds(seed: int | Sequence[int | None], count: int) -> list[int | None]:
    if isinstance(seed, int):
        return [seed + k for k in range(count)]
    if len(seed) != count:
        raise ValueError(f"seed: expected {count}, got {len(seed)}")
    return list(seed)
