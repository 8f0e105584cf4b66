"""Batch of worlds on mujoco-warp: MuJoCo's models in 32 bits, all worlds of an object in one launch, on a GPU or a CPU.

Only this module uses mujoco_warp and warp, which the extra `gpu` installs.

Worlds are grouped by object and by parameters that the engine sets for all worlds (rate, iterations, gravity). Within a group, all
other physics may differ: every model field in which scenes differ gets one row per world.

States are computed by torch on the device, from warp's arrays without a copy; `state` copies them to the CPU, `tensors` does not.

Kernels are compiled at the first step, for each kind of scene (tens of seconds); warp caches them in WARP_CACHE_PATH.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from afford.common.arrays import like, mapped, namespace, to_numpy
from afford.common.registry import extra
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
POSES, CONTACT = ("xpos", "xmat", "xquat", "qpos", "qvel", "actuator_force"), ("geom", "worldid", "efc_address", "dist")
"""fields that a state is computed from"""
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
        of_device = self._groups[0].state().q
        self._index = [like(rows, of_device) for rows in self._rows]
        self._order = like(np.argsort(np.concatenate(self._rows)), of_device)
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
        return mapped(_rows(self._state, chosen), to_numpy)

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance with u (n, m); RuntimeError when a world exceeds its capacity of contacts."""
        for rows, group in zip(self._rows, self._groups, strict=True):
            _checked("step, u", u[rows], (len(rows), group.motors))
        self.advance(u, control_s)
        return self.state()

    def advance(self, u: Any, control_s: float) -> None:
        """Advance with u (n, m), an array or a tensor; RuntimeError as `step`. Worlds with u that is not finite diverge."""
        u = like(u, self._state.q)
        for rows, index, group in zip(self._rows, self._index, self._groups, strict=True):
            self._left[rows] -= group.step(u[index], control_s, self._force[rows], self._left[rows])
        self._state = self._together([group.state() for group in self._groups])

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""
        chosen = np.arange(len(self.scenes)) if which is None else np.asarray(which, int)
        self._force[chosen] = force
        self._left[chosen] = [round(duration_s * self.scenes[k].physics.rate_hz) for k in chosen]

    def state(self) -> State:
        """Return the current states."""
        return mapped(self.tensors(), to_numpy)

    def tensors(self) -> State:
        """Return the current states as tensors on the device."""
        return mapped(self._state, lambda x: x.clone())

    def save(self) -> Saved:
        """Return a token of all that the next step depends on."""
        return Saved(tuple(group.save() for group in self._groups), self._force.copy(), self._left.copy(), self.state())

    def restore(self, token: Saved) -> State:
        """Restore a token."""
        for group, numbers in zip(self._groups, token.numbers, strict=True):
            group.restore(numbers)
        self._force, self._left = token.force.copy(), token.left.copy()
        self._state = mapped(token.state, lambda x: like(x, self._state.q))
        return self.state()

    def close(self) -> None:
        """Do nothing: garbage collection frees the engine."""

    def _together(self, states: Sequence[State]) -> State:
        """Concatenate the states of the groups in the order of the worlds."""
        if len(states) == 1:
            return states[0]
        torch, names = namespace(states[0].q), (f.name for f in fields(State))
        whole: dict[str, Any] = {name: torch.concatenate([getattr(state, name) for state in states])[self._order] for name in names}
        return State(**whole)


class _Group:
    """Worlds that share an object."""

    def __init__(self, scenes: Sequence[Scene], parts: int, device: str) -> None:
        self.scene, self.parts, self._warp, self._mjw = scenes[0], parts, extra("warp", "gpu"), extra("mujoco_warp", "gpu")
        self._warp.config.quiet = True
        self._device = _device(self._warp, device)
        models = _compiled(scenes)
        self._at: Layout = layout(models[0], scenes[0])
        with self._warp.ScopedDevice(self._device):
            self._model = _model(self._mjw, models)
            self._data = self._mjw.make_data(models[0], nworld=len(scenes), nconmax=CONTACTS, njmax=ROWS)
            self._mjw.forward(self._model, self._data)
        self._warp.synchronize()
        hand, first = self.scene.hand, self._tensor("qpos")
        self._palm, self._at = int(self._at.links[hand.palm]), mapped(self._at, lambda x: like(x, first))
        self._limits, self._com = like(scene_limits(self.scene), first), like(self.scene.body.com_m, first)
        self._tip_link, self._tip_m = self._at.links[like(hand.fingers.tip_link, first)], like(hand.fingers.tip_m, first)
        self._graph: Any = None
        self._pushed = False

    def reset(self, which: np.ndarray, q: np.ndarray, body: np.ndarray) -> None:
        """Reset worlds `which` of the group to rest, joints at q (k, d), motors holding them."""
        at, place = mapped(self._at, to_numpy), self._at.free[0] + np.arange(7)
        q, body = _checked("reset, q", q, (len(which), len(at.q))), _checked("reset, body", body, (len(which), 7))
        mask = np.zeros(self._data.nworld, bool)
        mask[which] = True
        with self._computing():
            self._mjw.reset_data(self._model, self._data, self._warp.array(mask, dtype=bool))
            qpos, ctrl = self._numbers("qpos"), self._numbers("ctrl")
            qpos[np.ix_(which, at.q)], qpos[np.ix_(which, place)] = q, body[:, [0, 1, 2, 6, 3, 4, 5]]
            ctrl[np.ix_(which, at.motors)] = [hold_command(self.scene, joints) for joints in q]
            self._data.qpos.assign(qpos)
            self._data.ctrl.assign(ctrl)
            self._mjw.forward(self._model, self._data)

    @property
    def motors(self) -> int:
        """Width of a command."""
        return len(self._at.motors)

    def step(self, u: Any, control_s: float, force: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Advance while the motors follow u (n, m), with `force` (n, 3) for the first `left` (n,) solver steps.

        Returns how many of those steps have passed.
        """
        count = solver_steps(control_s, self.scene.physics.rate_hz)
        over, ctrl = left.clip(max=count), self._tensor("ctrl")
        ctrl[:, self._at.motors] = u.clip(*self._limits.T).to(ctrl)
        with self._computing():
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
        with self._computing():
            for name, array in numbers.items():
                getattr(self._data, name).assign(array)

    def state(self) -> State:
        """Return states (n, ...) as tensors; positions are current, forces are those of the last solver step."""
        at, (q, v), torch = self._at, self._at.free, namespace(self._com)
        place, turn, quaternion, qpos, qvel, torque = (self._tensor(name).double() for name in POSES)
        R, palm, body_turn = turn[:, at.object], self._palm, qpos[:, q + 3 : q + 7]
        spin = (R @ qvel[:, v + 3 : v + 6, None])[..., 0]
        tips = torch.einsum("nkij,kj->nki", turn[:, self._tip_link], self._tip_m) + place[:, self._tip_link]
        force, deepest, contacts = self._touching()
        return State(
            q=qpos[:, at.q], qd=qvel[:, at.qd], torque=torque[:, at.motors], tips=tips,
            palm=torch.concatenate([place[:, palm], quaternion[:, palm].roll(-1, 1)], axis=1),
            body=torch.concatenate([qpos[:, q : q + 3], body_turn.roll(-1, 1)], axis=1),
            velocity=qvel[:, v : v + 3] + torch.linalg.cross(spin, R @ self._com), spin=spin, force=force, penetration_m=deepest,
            contacts=contacts)  # fmt: skip

    def _touching(self) -> tuple[Any, Any, Any]:
        """Measure contacts of the hand with the object.

        (n, fingers + 1, parts) newtons, (n,) depth of the deepest contact, (n,) number of contacts. All places of the capacity are
        summed, with 0 in those without such a contact, so that their number stays on the device.
        """
        n, fingers, torch = self._data.nworld, len(self.scene.hand.fingers.name) + 1, namespace(self._com)
        geom, of, row, dist = (self._warp.to_torch(getattr(self._data.contact, name)) for name in CONTACT)
        number = torch.arange(len(of), device=of.device)
        geom = geom.long().clip(0, len(self._at.part) - 1)
        finger, part, row = self._at.finger[geom].amax(dim=1), self._at.part[geom].amax(dim=1), row[:, 0].long()
        touch = (number < self._tensor("nacon")) & (finger >= 0) & (part >= 0) & (row >= 0)
        of, finger, part, row = (torch.where(touch, x, other) for x, other in ((of, number % n), (finger, 0), (part, 0), (row, 0)))
        pressed = torch.where(touch, self._warp.to_torch(self._data.efc.force)[of, row], 0.0).double()
        depth = torch.where(touch, -dist.double(), 0.0)
        zero = torch.zeros(n * fingers * self.parts, dtype=torch.float64, device=of.device)
        force = zero.index_add(0, (of * fingers + finger) * self.parts + part, pressed).reshape(n, fingers, self.parts)
        none = torch.zeros(n, dtype=torch.float64, device=of.device)
        return force, none.scatter_reduce(0, of, depth, "amax"), none.index_add(0, of, touch.double()).long()

    @contextmanager
    def _computing(self) -> Iterator[None]:
        """Context of the engine's work, in order with torch's: on a GPU, each has its own stream and waits for the other's."""
        with self._warp.ScopedDevice(self._device):
            if self._device == "cpu":
                yield
                return
            own, other = self._warp.get_stream(), self._warp.stream_from_torch(self._com.device)
            own.wait_stream(other)
            yield
            other.wait_stream(own)

    def _tensor(self, name: str) -> Any:
        """Return a field as tensor, without a copy."""
        return self._warp.to_torch(getattr(self._data, name))

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
    return mapped(state, lambda x: x[which])


def _put(state: State, which: np.ndarray, some: State) -> None:
    """Set the rows `which` of a state in place."""
    at = like(which, state.q)
    for f in fields(State):
        getattr(state, f.name)[at] = getattr(some, f.name)
