"""Batch of worlds on mujoco-warp: MuJoCo's models in 32 bits, all worlds of an object in one launch, on a GPU or a CPU.

Only this module uses mujoco_warp and warp, which the extra `gpu` installs.

Worlds are grouped by object and by parameters that the engine sets for all worlds (rate, iterations, gravity). Within a group, all
other physics may differ: every model field in which scenes differ gets one row per world.

Kernels are compiled at the first step, for each kind of scene (tens of seconds); warp caches them in WARP_CACHE_PATH.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from afford.common.registry import extra
from afford.grasping.hand.kinematics import points_on_links
from afford.grasping.sim.engine import State, World, make_world, solver_steps
from afford.grasping.sim.mujoco_world import Layout, compiled, layout
from afford.grasping.sim.scene import Scene, hold_command, scene_limits
from afford.grasping.sim.worlds import most_parts

EXTRA = "gpu"
PACKAGES = ("warp", "mujoco_warp")
CONTACTS, ROWS = 96, 320
"""capacity per world: contacts (shared by the worlds of a group) and constraint rows"""
IN_ORDER = 256
"""largest group of worlds whose sums are in a fixed order; the sort of more takes over 2 GiB, which warp cannot address"""
MOVING = ("qpos", "qvel", "qacc_warmstart", "ctrl", "time")
"""fields that the next step depends on"""


@dataclass(frozen=True, eq=False)
class Saved:
    """Saved state of all worlds."""

    numbers: tuple[dict[str, np.ndarray], ...]
    force: np.ndarray
    left: np.ndarray
    state: State


class WarpWorlds:
    """Worlds that are computed together; see afford.grasping.sim.worlds.WorldBatch."""

    def __init__(self, scenes: Sequence[Scene], device: str = "cpu") -> None:
        """Create the worlds on a `device`: cpu, cuda or cuda:N.

        ValueError when the extra is not installed, the device does not exist, mujoco-warp cannot compute a scene, and as
        ThreadWorlds.
        """
        self.scenes, self.parts, n = tuple(scenes), most_parts(scenes), len(scenes)
        alike: dict[Any, list[int]] = {}
        for k, scene in enumerate(scenes):
            physics = scene.physics
            alike.setdefault((id(scene.body), physics.rate_hz, physics.iterations, physics.gravity_m_s2), []).append(k)
        self._rows = [np.array(rows) for rows in alike.values()]
        self._groups = [_Group([scenes[k] for k in rows], self.parts, device) for rows in alike.values()]
        self._force, self._left = np.zeros((n, 3)), np.zeros(n, int)
        self._state = self._together([group.state() for group in self._groups])

    def single_world(self, k: int) -> World:
        """Return a MuJoCo world of scene k, because warp worlds are only computed together."""
        return make_world("mujoco", self.scenes[k])

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """Reset the worlds `which`, or all, to q (k, d) and body (k, 7)."""
        chosen = np.arange(len(self.scenes)) if which is None else np.asarray(which, int)
        for rows, group in zip(self._rows, self._groups, strict=True):
            mine = np.flatnonzero(np.isin(chosen, rows))
            if len(mine):
                at = np.searchsorted(rows, chosen[mine])
                group.reset(at, q[mine], body[mine])
                _put(self._state, chosen[mine], _rows(group.state(), at))
        self._force[chosen], self._left[chosen] = 0.0, 0
        return _rows(self._state, chosen)

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance with u (n, m); RuntimeError when a world exceeds its capacity of contacts."""
        for rows, group in zip(self._rows, self._groups, strict=True):
            self._left[rows] -= group.step(u[rows], control_s, self._force[rows], self._left[rows])
        self._state = self._together([group.state() for group in self._groups])
        return self.state()

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""
        chosen = np.arange(len(self.scenes)) if which is None else np.asarray(which, int)
        self._force[chosen] = force
        self._left[chosen] = [round(duration_s * self.scenes[k].physics.rate_hz) for k in chosen]

    def state(self) -> State:
        """Return the current states."""
        return _rows(self._state, np.arange(len(self.scenes)))

    def save(self) -> Saved:
        """Return a token of all that the next step depends on."""
        return Saved(tuple(group.save() for group in self._groups), self._force.copy(), self._left.copy(), self.state())

    def restore(self, token: Saved) -> State:
        """Restore a token."""
        for group, numbers in zip(self._groups, token.numbers, strict=True):
            group.restore(numbers)
        self._force, self._left = token.force.copy(), token.left.copy()
        self._state = _rows(token.state, np.arange(len(self.scenes)))
        return self.state()

    def close(self) -> None:
        """Do nothing: garbage collection frees the engine."""

    def _together(self, states: Sequence[State]) -> State:
        """Concatenate the states of the groups in the order of the worlds."""
        order = np.argsort(np.concatenate(self._rows))
        names = (f.name for f in fields(State))
        whole: dict[str, Any] = {name: np.concatenate([getattr(state, name) for state in states])[order] for name in names}
        return State(**whole)


class _Group:
    """Worlds that share an object."""

    def __init__(self, scenes: Sequence[Scene], parts: int, device: str) -> None:
        self.scene, self.parts, self._warp, self._mjw = scenes[0], parts, extra("warp", "gpu"), extra("mujoco_warp", "gpu")
        self._warp.config.quiet = True
        self._device = _device(self._warp, device)
        models = _compiled(scenes)
        self._at: Layout = layout(models[0], scenes[0])
        self._limits = scene_limits(self.scene)
        with self._warp.ScopedDevice(self._device):
            self._model = _model(self._mjw, models)
            self._data = self._mjw.make_data(models[0], nworld=len(scenes), nconmax=CONTACTS, njmax=ROWS)
            self._mjw.forward(self._model, self._data)
        self._graph: Any = None
        self._pushed = False

    def reset(self, which: np.ndarray, q: np.ndarray, body: np.ndarray) -> None:
        """Reset worlds `which` of the group to rest, joints at q (k, d), motors holding them."""
        at, place = self._at, self._at.free[0] + np.arange(7)
        q, body = _checked("reset, q", q, (len(which), len(at.q))), _checked("reset, body", body, (len(which), 7))
        mask = np.zeros(self._data.nworld, bool)
        mask[which] = True
        with self._warp.ScopedDevice(self._device):
            self._mjw.reset_data(self._model, self._data, self._warp.array(mask, dtype=bool))
            qpos, ctrl = self._numbers("qpos"), self._numbers("ctrl")
            qpos[np.ix_(which, at.q)], qpos[np.ix_(which, place)] = q, body[:, [0, 1, 2, 6, 3, 4, 5]]
            ctrl[np.ix_(which, at.motors)] = [hold_command(self.scene, joints) for joints in q]
            self._data.qpos.assign(qpos)
            self._data.ctrl.assign(ctrl)
            self._mjw.forward(self._model, self._data)

    def step(self, u: np.ndarray, control_s: float, force: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Advance while the motors follow u (n, m), with `force` (n, 3) for the first `left` (n,) solver steps.

        Returns how many of those steps have passed.
        """
        count = solver_steps(control_s, self.scene.physics.rate_hz)
        over, ctrl = left.clip(max=count), self._numbers("ctrl")
        ctrl[:, self._at.motors] = _checked("step, u", u, (len(ctrl), len(self._at.motors))).clip(*self._limits.T)
        with self._warp.ScopedDevice(self._device):
            self._data.ctrl.assign(ctrl)
            ends = np.unique([0, count, *over]).tolist()
            for start, end in pairwise(ends):
                self._push(np.where((over > start)[:, None], force, 0.0))
                self._advance(end - start)
            self._mjw.kinematics(self._model, self._data)
        self._judge()
        return over

    def save(self) -> dict[str, np.ndarray]:
        return {name: self._numbers(name) for name in MOVING}

    def restore(self, numbers: dict[str, np.ndarray]) -> None:
        for name, array in numbers.items():
            getattr(self._data, name).assign(array)

    def state(self) -> State:
        """Return states (n, ...); positions are current, forces are those of the last solver step."""
        at, hand, n = self._at, self.scene.hand, self._data.nworld
        place, turn, quaternion = (self._numbers(name).astype(np.float64) for name in ("xpos", "xmat", "xquat"))
        qpos, qvel = (self._numbers(name).astype(np.float64) for name in ("qpos", "qvel"))
        T = np.zeros((n, len(at.links), 4, 4))
        T[..., :3, :3], T[..., :3, 3] = turn[:, at.links], place[:, at.links]
        q, v = at.free
        R, palm = turn[:, at.object], at.links[hand.palm]
        spin = (R @ qvel[:, v + 3 : v + 6, None])[..., 0]
        force, deepest, contacts = self._touching()
        return State(
            q=qpos[:, at.q], qd=qvel[:, at.qd], torque=self._numbers("actuator_force").astype(np.float64)[:, at.motors],
            tips=points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m),
            palm=np.concatenate([place[:, palm], quaternion[:, palm][:, [1, 2, 3, 0]]], axis=1),
            body=qpos[:, q + np.array([0, 1, 2, 4, 5, 6, 3])],
            velocity=qvel[:, v : v + 3] + np.cross(spin, R @ self.scene.body.com_m), spin=spin, force=force,
            penetration_m=deepest, contacts=contacts)  # type: ignore[arg-type]  # (n,) for numbers  # fmt: skip

    def _touching(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measure contacts of the hand with the object.

        (n, fingers + 1, parts) newtons, (n,) depth of the deepest contact, (n,) number of contacts.
        """
        n, contact, count = self._data.nworld, self._data.contact, int(self._data.nacon.numpy()[0])
        geom, of, row, dist = (getattr(contact, name).numpy()[:count] for name in ("geom", "worldid", "efc_address", "dist"))
        finger, part, row = self._at.finger[geom].max(axis=1), self._at.part[geom].max(axis=1), row[:, 0]
        touch = (finger >= 0) & (part >= 0) & (row >= 0)
        of, row = of[touch], row[touch]
        force, deepest = np.zeros((n, len(self.scene.hand.fingers.name) + 1, self.parts)), np.zeros(n)
        np.add.at(force, (of, finger[touch], part[touch]), self._data.efc.force.numpy()[of, row])
        np.maximum.at(deepest, of, -dist[touch].astype(np.float64))
        return force, deepest, np.bincount(of, minlength=n)

    def _numbers(self, name: str) -> np.ndarray:
        """Return a copy of a field."""
        found: np.ndarray = np.array(getattr(self._data, name).numpy())
        return found

    def _push(self, force: np.ndarray) -> None:
        if not force.any() and not self._pushed:
            return
        wrench, self._pushed = self._numbers("xfrc_applied"), bool(force.any())
        wrench[:, self._at.object, :3] = force
        self._data.xfrc_applied.assign(wrench)

    def _advance(self, count: int) -> None:
        """Run solver steps; on a GPU the launches of one step are captured once and replayed."""
        if self._device == "cpu":
            for _ in range(count):
                self._mjw.step(self._model, self._data)
            return
        if self._graph is None:
            self._mjw.step(self._model, self._data)  # compiles the kernels, which a capture must not do
            with self._warp.ScopedCapture() as capture:
                self._mjw.step(self._model, self._data)
            self._graph, count = capture.graph, count - 1
        for _ in range(count):
            self._warp.capture_launch(self._graph)

    def _judge(self) -> None:
        """Raise RuntimeError when a capacity was exceeded."""
        kinds = self._mjw.OverflowType
        few = int(kinds.ITERATIONS | kinds.LS_ITERATIONS)  # the solver stopped before convergence, which is allowed
        if (self._data.overflow.numpy() & ~few).any():
            raise RuntimeError(f"{self.scene.body.name}: expected at most {CONTACTS} contacts and {ROWS} rows of constraints in a "
                               "world, got more; raise CONTACTS and ROWS of afford/grasping/sim/warp_worlds.py")


def _compiled(scenes: Sequence[Scene]) -> list[Any]:
    """Compile the model of each scene; scenes with the same hand, body and physics share one."""
    keys = [(id(scene.hand), id(scene.body), scene.physics, scene.wrist) for scene in scenes]
    made = {key: compiled(scene) for key, scene in dict(zip(keys, scenes, strict=True)).items()}
    return [made[key] for key in keys]


def _checked(name: str, found: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    out = np.asarray(found, np.float64)
    if out.shape != shape or not np.isfinite(out).all():
        raise ValueError(f"{name}: expected finite numbers of shape {shape}, got {out}")
    return out


def _device(warp: Any, device: str) -> str:
    kind, _, number = device.partition(":")
    if kind not in ("cpu", "cuda") or (kind == "cpu" and number) or not f"{number or 0}".isdigit():
        raise ValueError(f"device: expected cpu, cuda or cuda:N, got {device!r}")
    if kind == "cuda" and int(number or 0) >= warp.get_cuda_device_count():
        raise ValueError(f"device: CUDA finds no GPU for {device}; use cpu")
    return device


def _model(mjw: Any, models: Sequence[Any]) -> Any:
    """Build one model for all worlds, with one row per world for every field in which they differ."""
    first, others = models[0], {id(model): model for model in models[1:]}.values()
    batched = [f.name for f in fields(mjw.Model) if getattr(f.type, "shape", ())[:1] == ("*",) and hasattr(first, f.name)]
    varied = [name for name in batched if any(not np.array_equal(getattr(first, name), getattr(m, name)) for m in others)]
    try:
        model = mjw.put_model(first, batch_sizes=dict.fromkeys(varied, len(models)))
    except NotImplementedError as error:
        raise ValueError(f"mujoco-warp: expected a scene that it can compute, got one with {error}; use mujoco") from error
    for name in varied:
        getattr(model, name).assign(np.stack([getattr(m, name) for m in models]).astype(np.float32))
    if len(models) <= IN_ORDER:
        model.opt.deterministic = int(mjw.DeterminismType.ALL)
    model.opt.warn_overflow = 0
    return model


def _rows(state: State, which: np.ndarray) -> State:
    return State(**{f.name: getattr(state, f.name)[which] for f in fields(State)})


def _put(state: State, which: np.ndarray, some: State) -> None:
    for f in fields(State):
        getattr(state, f.name)[which] = getattr(some, f.name)
