"""Gymnasium environments over n worlds: one world as `Env`, many as `VectorEnv`; and their adapter for PPO.

A world of `VectorEnv` whose episode ends is reset in the same step. The observation is then the first of the next episode, and
`final_obs` the last of the one that ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import gymnasium.vector
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from afford.common.arrays import to_numpy
from afford.grasping.env.obs_blocks import LIMIT
from afford.grasping.env.step_result import BatchedWorlds, StepResult


class Env(gymnasium.Env):
    """Gymnasium environment of one world."""

    metadata = {"render_modes": []}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, core: BatchedWorlds) -> None:
        self._core = core
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (core.width,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (core.motors,), np.float32)
        self._over = True

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed gives the same episode."""
        super().reset(seed=seed)
        self._core.reset([0], [self.np_random])
        self._over = False
        return self._core.observe()[0], {"success": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Apply an action (m,) for one control step. RuntimeError after the end of an episode.

        The info has `success`, every reward term as `reward/NAME`, and `report` at the end of an episode.
        """
        if self._over:
            raise RuntimeError(f"{type(self).__name__}: no episode is running; call reset() before step()")
        out = self._core.step(np.asarray(action)[None], [self.np_random])
        info: dict[str, Any] = {"success": bool(out.success[0])}
        info |= {f"reward/{name}": float(term[0]) for name, term in out.terms.items()}
        self._over = bool(out.done[0])
        if self._over:
            info["report"] = {name: float(figure[0]) for name, figure in self._core.report().items()}
        return self._core.observe()[0], float(out.reward[0]), bool(out.terminated[0]), bool(out.truncated[0]), info

    def save(self) -> Any:
        """Snapshot of the state that the next steps depend on."""
        return self._core.save(), self.np_random.bit_generator.state, self._over

    def restore(self, token: Any) -> np.ndarray:
        """Return to a snapshot; the observation (d,)."""
        self._core.restore(token[0])
        self.np_random.bit_generator.state = token[1]
        self._over = token[2]
        return self._core.observe()[0]

    def close(self) -> None:
        """Release the engine; a second call does nothing."""
        self._core.close()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(observation={self.observation_space.shape}, action={self.action_space.shape})"


class VectorEnv(gymnasium.vector.VectorEnv):
    """Gymnasium vector environment of n worlds, reset in the step that ends an episode."""

    metadata = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}  # noqa: RUF012  # gymnasium's

    def __init__(self, core: BatchedWorlds, num_envs: int) -> None:
        self._core, self.num_envs = core, num_envs
        self.single_observation_space = spaces.Box(-LIMIT, LIMIT, (core.width,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (core.motors,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs: list[np.random.Generator] = []

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:  # fmt: skip
        """Begin an episode in every world. An integer seeds world k with seed + k; without a seed the generators continue."""
        if seed is not None or not self._rngs:
            seeds = [None] * self.num_envs if seed is None else _seeds(seed, self.num_envs)
            self._rngs = [np.random.default_rng(one) for one in seeds]
        self._core.reset(range(self.num_envs), self._rngs)
        return self._core.observe(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions (n, m) for one control step; gymnasium's tuple.

        Infos have `success` (n,), every reward term as `reward/NAME` (n,), and `final_obs` and `final_info` where episodes ended.
        """
        out = self.advance(actions)
        infos: dict[str, Any] = {"success": out.success, **{f"reward/{name}": term for name, term in out.terms.items()}}
        if out.done.any():
            last = np.full(self.num_envs, None, dtype=object)
            for k in np.flatnonzero(out.done):
                last[k] = out.final_obs[k]
            infos |= {"final_obs": last, "_final_obs": out.done, "final_info": {"report": out.report, "_report": out.done},
                      "_final_info": out.done}  # fmt: skip
        return out.obs, out.reward, out.terminated, out.truncated, infos

    def advance(self, actions: np.ndarray) -> StepResult:
        """Apply actions (n, m) for one control step, and reset the worlds whose episode ended."""
        out = self._core.step(actions, self._rngs)
        final_obs = self._core.observe()
        if not out.done.any():
            return replace(out, obs=final_obs, final_obs=final_obs)
        report = self._core.report()
        self._core.reset(np.flatnonzero(to_numpy(out.done)).tolist(), self._rngs)
        return replace(out, obs=self._core.observe(), final_obs=final_obs, report=report)

    def save(self) -> Any:
        """Snapshot of the state that the next steps depend on."""
        return self._core.save(), [rng.bit_generator.state for rng in self._rngs]

    def restore(self, token: Any) -> np.ndarray:
        """Return to a snapshot; the observations (n, d)."""
        self._core.restore(token[0])
        for rng, state in zip(self._rngs, token[1], strict=True):
            rng.bit_generator.state = state
        return self._core.observe()

    def close_extras(self, **kwargs: Any) -> None:
        """Release the engines."""
        self._core.close()


class PPOEnvAdapter:
    """VectorEnv as PPO's VecEnv: scales the reward and reports reward terms and figures of ended episodes as metrics."""

    def __init__(self, envs: VectorEnv, seed: int, scale: float = 0.1) -> None:
        self.envs, self.seed, self.scale = envs, seed, scale

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        return self.envs.reset(seed=self.seed)[0]

    def step(self, action: np.ndarray) -> StepResult:
        """Apply actions (n, m) for one control step."""
        out = self.envs.advance(action)
        metrics = {f"reward/{name}": term.mean() for name, term in out.terms.items()}
        ended = mean_report(out.report, to_numpy(out.done)) if out.report else {}
        return replace(out, reward=self.scale * out.reward, metrics=metrics | ended)


def mean_report(report: dict[str, np.ndarray], which: np.ndarray) -> dict[str, float]:
    """Mean of every figure (n,) over the episodes `which` (n,) bool. NaN values are left out, and figures without any value."""
    kept = {name: figure[which & ~np.isnan(figure)] for name, figure in report.items()}
    return {name: float(figure.mean()) for name, figure in kept.items() if len(figure)}


def _seeds(seed: int | Sequence[int | None], count: int) -> list[int | None]:
    if isinstance(seed, int):
        return [seed + k for k in range(count)]
    if len(seed) != count:
        raise ValueError(f"seed: expected {count}, got {len(seed)}")
    return list(seed)
