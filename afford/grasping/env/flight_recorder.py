"""Flight recorder: the last control steps of every world, written to a file where a world diverges.

A world has diverged when its state is not finite, or faster than a bound. Without a recorder that is an
error. With one, the world is set back to the start of its episode, the episode is terminated, and the run goes on.
"""

from __future__ import annotations

import shutil
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from afford.common.arrays import namespace, to_numpy
from afford.grasping.sim.engine import State

FASTEST, OBJECT_M_S = 200.0, 50.0
"""speed beyond which a world has diverged: of a joint (rad/s, m/s) or of the object's spin (rad/s); of the object's centre of mass.
MuJoCo and PyBullet clamp all of them at 100, which a joint without load reaches"""
STEPS = 20
"""control steps that are kept of each world"""
MOST = 64
"""files that are written at most; later divergences are only counted"""
ROWS = ("q", "qd", "body", "velocity", "spin", "force")
"""fields of State in a file, (t, ...)"""
FOLDER = "diverged"
"""folder of the files, within the scratch of a training and within its output"""


class FlightRecorder:
    """Last control steps of n worlds, and the number of divergences.

    A file `PART-STEP-world-K.npz` has up to 20 control steps of an episode, oldest first: the fields ROWS of the state after each
    step, `action` (t, m) and `step` (t,); and `world`, `seed`, `part`, `task` and `engine`.
    """

    def __init__(self, scratch: Path, engine: str, seed: int) -> None:
        """Record into `diverged` of the folder `scratch`, which is created with the first file; `seed` is that of the training."""
        self.folder, self.engine, self.seed = scratch / FOLDER, engine, seed
        self.begin(0)

    def begin(self, part: int) -> None:
        """Begin part `part` of the training, which starts with new episodes: a section, an update or a round."""
        self.part, self.count, self._steps = part, 0, 0
        self._rows: deque[dict[str, np.ndarray]] = deque(maxlen=STEPS)

    def take_count(self) -> dict[str, float]:
        """Scalar `diverged` of a log: divergences since the last call or `begin`; empty without any."""
        count, self.count = self.count, 0
        return {"diverged": float(count)} if count else {}

    def record(self, state: State, action: np.ndarray, step: np.ndarray) -> None:
        """Add a control step of all worlds: the state after it, the actions (n, m), and its number in each episode (n,)."""
        self._rows.append({**{name: getattr(state, name) for name in ROWS}, "action": action, "step": step})
        self._steps += 1

    def write(self, k: int, task: str) -> None:
        """Count a divergence of world k, and write its file."""
        self.count += 1
        path = self.folder / f"{self.part:05d}-{self._steps:04d}-world-{k}.npz"
        if path.exists() or len(list(self.folder.glob("*.npz"))) < MOST:
            self.folder.mkdir(parents=True, exist_ok=True)
            own = list(self._rows)[-(int(self._rows[-1]["step"][k]) + 1) :]  # without rows of the episode before
            arrays: dict[str, Any] = {name: np.stack([to_numpy(row[name][k]) for row in own]) for name in own[-1]}
            np.savez(path, world=k, seed=self.seed, part=self.part, task=task, engine=self.engine, **arrays)


def diverged(state: State) -> np.ndarray:
    """(n,) bool, the state of a world is not finite, or faster than FASTEST or OBJECT_M_S."""
    xp = namespace(state.q)
    place = xp.concatenate([state.q, state.body], axis=1)
    speed = xp.concatenate([state.qd / FASTEST, state.spin / FASTEST, state.velocity / OBJECT_M_S], axis=1)
    found: np.ndarray = ~xp.isfinite(place).all(axis=1) | ~(xp.abs(speed) <= 1).all(axis=1)
    return found


def export_records(scratch: Path, root: Path) -> None:
    """Copy the files of a training, if any, into `diverged` of its output `root`."""
    if (scratch / FOLDER).exists():
        shutil.copytree(scratch / FOLDER, root / FOLDER)
