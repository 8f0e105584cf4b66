"""One world, in gymnasium's words: what AffordanceGrasp and HandImitation share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np
from gymnasium import spaces

from afford.grasping.env.happened import Happened
from afford.grasping.env.observe import LIMIT


class Core(Protocol):
    """n worlds at once, as core.Grasping and imitate.Imitating are."""

    @property
    def motors(self) -> int:
        """Width of an action."""

    @property
    def width(self) -> int:
        """Of an observation."""

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`, from the generators of all worlds."""

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> Happened:
        """Act (n, m)."""

    def observe(self) -> np.ndarray:
        """(n, width) float32."""

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of episodes that end now."""

    def save(self) -> Any:
        """Everything that the next step depends on, but the generators."""

    def restore(self, token: Any) -> None:
        """Back to what was saved."""

    def close(self) -> None:
        """Give the engine back; twice is harmless."""


class Single(gymnasium.Env):
    """A core of one world."""

    metadata = {"render_modes": []}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, core: Core) -> None:
        self._core = core
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (core.width,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (core.motors,), np.float32)
        self._over = True

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed gives the same."""
        super().reset(seed=seed)
        self._core.reset([0], [self.np_random])
        self._over = False
        return self._core.observe()[0], {"success": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """A twentieth of a second. RuntimeError when the episode is over."""
        if self._over:
            raise RuntimeError(f"{type(self).__name__}: expected a reset, since no episode is under way")
        out = self._core.step(np.asarray(action)[None], [self.np_random])
        info: dict[str, Any] = {"success": bool(out.success[0])}
        info |= {f"reward/{name}": float(term[0]) for name, term in out.terms.items()}
        self._over = bool(out.terminated[0] or out.truncated[0])
        if self._over:
            info["report"] = {name: float(figure[0]) for name, figure in self._core.report().items()}
        return self._core.observe()[0], float(out.reward[0]), bool(out.terminated[0]), bool(out.truncated[0]), info

    def save(self) -> Any:
        """Everything that the next steps depend on."""
        return self._core.save(), self.np_random.bit_generator.state, self._over

    def restore(self, token: Any) -> np.ndarray:
        """Back to what was saved; it goes on as it did then. The observation."""
        self._core.restore(token[0])
        self.np_random.bit_generator.state = token[1]
        self._over = token[2]
        return self._core.observe()[0]

    def close(self) -> None:
        """Give the engine back; twice is harmless."""
        self._core.close()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(observation={self.observation_space.shape}, action={self.action_space.shape})"
