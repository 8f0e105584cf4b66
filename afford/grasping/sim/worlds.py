"""Batches of worlds as arrays (n, ...): on threads, in processes, or in an engine that computes all of them together.

MuJoCo releases Python's lock, so threads help. PyBullet computes one world after another in a process, so it needs processes: each
process has a share of the worlds, receives the name of a method and its arguments, and replies with the result or the exception.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from afford.common.registry import load
from afford.grasping.sim.engine import DivergedError, State, World, make_world
from afford.grasping.sim.scene import Scene


def most_parts(scenes: Sequence[Scene]) -> int:
    """Return the largest number of parts among the objects of scenes.

    ValueError without scenes, or for hands that differ in their joints.
    """
    names = {scene.hand.joints.name for scene in scenes}
    if len(names) != 1:
        raise ValueError(f"Worlds: expected one scene or more, with one hand, got {len(scenes)} with {len(names)} hands")
    return max(len(scene.body.parts) for scene in scenes)


UNKNOWN = ("q", "qd", "body", "velocity", "spin")
"""fields of State that are NaN where a world diverged"""


class ThreadWorlds:
    """Worlds in this process, on threads; see WorldBatch.

    `parts` is the largest number of parts of an object; forces on objects with fewer parts are padded with 0.
    """

    def __init__(self, engine: str, scenes: Sequence[Scene], threads: int = 1) -> None:
        """ValueError for no scenes, hands that differ in their joints, or no threads."""
        if threads < 1:
            raise ValueError(f"Worlds: expected one thread or more, got {threads}")
        self.scenes, self.parts = tuple(scenes), most_parts(scenes)
        self.worlds: tuple[World, ...] = tuple(make_world(engine, scene) for scene in scenes)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def single_world(self, k: int) -> World:
        """Return world k."""
        return self.worlds[k]

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """Reset the worlds `which`, or all, to q (k, d) and body (k, 7)."""
        return self._each(lambda k, row: self.worlds[k].reset(q[row], body[row]), which)

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance all worlds with commands u (n, m)."""
        return self._each(lambda k, row: self._advance(k, u[row], control_s), None)

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""
        for k, row in zip(range(len(self.worlds)) if which is None else which, force, strict=True):
            self.worlds[k].push(row, duration_s)

    def state(self) -> State:
        """Return the current states."""
        return self._each(lambda k, row: self.worlds[k].state(), None)

    def save(self) -> tuple[Any, ...]:
        """Return a token of every world."""
        return tuple(world.save() for world in self.worlds)

    def restore(self, tokens: Sequence[Any]) -> State:
        """Restore every world to its token."""
        return self._each(lambda k, row: self.worlds[k].restore(tokens[row]), None)

    def close(self) -> None:
        """Close all worlds; closing twice is allowed."""
        for world in self.worlds:
            world.close()
        if self._pool is not None:
            self._pool.shutdown()

    def _advance(self, k: int, u: np.ndarray, control_s: float) -> State:
        try:
            return self.worlds[k].step(u, control_s)
        except DivergedError:
            state = self.worlds[k].state()
            unknown = {name: np.full_like(getattr(state, name), np.nan) for name in UNKNOWN}
            return replace(state, **unknown)  # type: ignore[arg-type]  # all of them are arrays

    def _each(self, act: Callable[[int, int], State], which: Sequence[int] | None) -> State:
        chosen = range(len(self.worlds)) if which is None else which
        rows = range(len(chosen))
        found = (self._pool.map if self._pool else map)(act, chosen, rows)
        return self._stacked(list(found))

    def _stacked(self, states: Sequence[State]) -> State:
        """Stack states to arrays (n, ...); force is padded with 0 for objects with fewer parts."""
        columns = {f.name: [getattr(state, f.name) for state in states] for f in fields(State)}
        force = np.zeros((len(states), len(states[0].force), self.parts))
        for row, one in zip(force, columns.pop("force"), strict=True):
            row[:, : one.shape[1]] = one
        arrays: dict[str, Any] = {name: np.array(column) for name, column in columns.items()}
        return State(force=force, **arrays)


LEAVE_S = 10.0
"""time after which a process that does not exit is terminated"""


class ProcessWorlds:
    """Worlds in several processes, with the same bits as ThreadWorlds; see WorldBatch."""

    def __init__(self, engine: str, scenes: Sequence[Scene], threads: int = 1, processes: int = 2) -> None:
        """ValueError as ThreadWorlds; RuntimeError when a process does not start."""
        self.parts = most_parts(scenes)
        self._shares = np.array_split(np.arange(len(scenes)), max(1, min(processes, len(scenes))))
        self._workers = [_Worker(engine, [scenes[k] for k in share], threads) for share in self._shares]
        try:
            for worker in self._workers:
                worker.result()
        except Exception:
            self.close()
            raise

    def single_world(self, k: int) -> World:
        """Return world k, in its process."""
        number = int(np.searchsorted([share[-1] for share in self._shares], k))
        return cast(World, _Remote(self._workers[number], k - int(self._shares[number][0])))

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """Reset the worlds `which`, or all, to q (k, d) and body (k, 7)."""
        chosen = np.arange(self._shares[-1][-1] + 1) if which is None else np.asarray(which, int)
        mine = [np.flatnonzero(np.isin(chosen, share)) for share in self._shares]
        found = self._all("reset", [(q[rows], body[rows], (chosen[rows] - share[0]).tolist()) if len(rows) else None
                                    for rows, share in zip(mine, self._shares, strict=True)])  # fmt: skip
        return self._joined([state for state in found if state is not None], np.concatenate(mine))

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance all worlds with commands u (n, m)."""
        return self._joined(self._all("step", [(u[share], control_s) for share in self._shares]))

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""
        chosen = np.arange(self._shares[-1][-1] + 1) if which is None else np.asarray(which, int)
        mine = [np.flatnonzero(np.isin(chosen, share)) for share in self._shares]
        self._all("push", [(force[rows], duration_s, (chosen[rows] - share[0]).tolist()) if len(rows) else None
                           for rows, share in zip(mine, self._shares, strict=True)])  # fmt: skip

    def state(self) -> State:
        """Return the current states."""
        return self._joined(self._all("state", [() for _ in self._shares]))

    def save(self) -> tuple[Any, ...]:
        """Return a token of every process."""
        return tuple(self._all("save", [() for _ in self._shares]))

    def restore(self, tokens: Sequence[Any]) -> State:
        """Restore every world to its token."""
        return self._joined(self._all("restore", [(token,) for token in tokens]))

    def close(self) -> None:
        """End the processes; closing twice is allowed."""
        for worker in self._workers:
            worker.close()

    def _all(self, method: str, arguments: Sequence[tuple[Any, ...] | None]) -> list[Any]:
        """Send a request to every process with arguments, then collect all replies, so that processes run in parallel.

        The first error is raised after all processes have replied.
        """
        requests = list(zip(self._workers, arguments, strict=True))
        try:
            for worker, given in requests:
                if given is not None:
                    worker.send(None, method, given)
            answers = [worker.receive() if given is not None else None for worker, given in requests]
        except RuntimeError:  # a process has ended: later replies of the others would not match their requests
            self.close()
            raise
        return [_value(answer) for answer in answers]

    def _joined(self, states: Sequence[State], order: np.ndarray | None = None) -> State:
        """Concatenate states; `order` (k,) is the position of each row.

        force is padded with 0 for objects with fewer parts.
        """
        columns = {f.name: [getattr(state, f.name) for state in states] for f in fields(State)}
        columns["force"] = [np.pad(force, ((0, 0), (0, 0), (0, self.parts - force.shape[2]))) for force in columns["force"]]
        place = slice(None) if order is None else np.argsort(order)
        whole: dict[str, Any] = {name: np.concatenate(column)[place] for name, column in columns.items()}
        return State(**whole)


class _Worker:
    """Handle of a process that runs some worlds."""

    def __init__(self, engine: str, scenes: Sequence[Scene], threads: int) -> None:
        context = get_context("spawn")
        self._line, other = context.Pipe()
        self._names = ", ".join(sorted({scene.body.name for scene in scenes}))
        self._process = context.Process(target=_serve, args=(other, engine, list(scenes), threads), daemon=True)
        self._process.start()
        other.close()  # so that this end sees the end of the process

    def send(self, k: int | None, method: str, arguments: tuple[Any, ...]) -> None:
        try:
            self._line.send((k, method, arguments))
        except (BrokenPipeError, OSError) as error:
            raise self._gone() from error

    def receive(self) -> Any:
        try:
            return self._line.recv()
        except (EOFError, ConnectionResetError) as error:
            raise self._gone() from error

    def result(self) -> Any:
        """Receive a result, or raise the exception that the process sent."""
        return _value(self.receive())

    def close(self) -> None:
        if not self._line.closed:
            self._line.close()
            self._process.join(LEAVE_S)
            if self._process.is_alive():
                self._process.terminate()
                self._process.join()

    def _gone(self) -> RuntimeError:
        self._process.join(LEAVE_S)
        code = self._process.exitcode
        return RuntimeError(f"worlds with {self._names}: their process ended (exit code {code}); it may have run out of memory: "
                            "use fewer worlds or processes")  # fmt: skip


class _Remote:
    """One world of another process; see World."""

    def __init__(self, worker: _Worker, k: int) -> None:
        self._worker, self._k = worker, k

    def reset(self, q: np.ndarray, body: np.ndarray) -> State:
        return cast(State, self._call("reset", q, body))

    def step(self, u: np.ndarray, control_s: float) -> State:
        return cast(State, self._call("step", u, control_s))

    def push(self, force: np.ndarray, duration_s: float) -> None:
        self._call("push", force, duration_s)

    def state(self) -> State:
        return cast(State, self._call("state"))

    def save(self) -> Any:
        return self._call("save")

    def restore(self, token: Any) -> State:
        return cast(State, self._call("restore", token))

    def close(self) -> None:
        """Do nothing: the process closes its worlds."""

    def _call(self, method: str, *arguments: Any) -> Any:
        self._worker.send(self._k, method, arguments)
        return self._worker.result()


def _value(answer: Any) -> Any:
    if isinstance(answer, Exception):
        raise answer
    return answer


def _serve(line: Connection, engine: str, scenes: Sequence[Scene], threads: int) -> None:
    """Process main loop: create the worlds, then run requests until the pipe is closed."""
    worlds: ThreadWorlds | None = None
    message: Any = (None, "", ())
    while message is not None:
        k, method, arguments = message
        try:
            if worlds is None:
                worlds, answer = ThreadWorlds(engine, scenes, threads), None
            else:
                answer = getattr(worlds if k is None else worlds.worlds[k], method)(*arguments)
        except Exception as error:  # raised in the process that sent the request
            answer = error
        message = _reply(line, answer)
    if worlds is not None:
        worlds.close()


def _reply(line: Connection, answer: Any) -> Any:
    """Send a reply and receive the next request; None when the pipe is closed."""
    try:
        line.send(answer)
        return line.recv()
    except (EOFError, OSError):
        return None


TOGETHER = {"warp": "afford.grasping.sim.warp_worlds:WarpWorlds"}
"""engines that compute all worlds at once, on a device"""


class WorldBatch(Protocol):
    """Batch of n worlds, whose scenes may differ in object and physics but not in hand; all arrays are copies."""

    def single_world(self, k: int) -> World:
        """Return world k by itself, for example to let its object come to rest.

        Engines that only compute all worlds together return a MuJoCo world.
        """

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """Reset the worlds `which`, or all, to q (k, d) and body (k, 7), and return their states."""

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance all worlds with commands u (n, m). A world that diverged has NaN in its state, and needs a reset."""

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""

    def state(self) -> State:
        """Return the current states."""

    def save(self) -> Any:
        """Return a token of all that the next step depends on."""

    def restore(self, token: Any) -> State:
        """Restore a token."""

    def close(self) -> None:
        """Release the engine; closing twice is allowed."""


@runtime_checkable
class DeviceBatch(WorldBatch, Protocol):
    """Batch of worlds of an engine that computes them together on a device, where torch reads and commands them without a copy."""

    def advance(self, u: Any, control_s: float) -> None:
        """Advance all worlds with commands u (n, m), an array or a tensor."""

    def tensors(self) -> State:
        """Return the current states as tensors on the device."""


def world_batch(engine: str, scenes: Sequence[Scene], threads: int = 1, processes: int = 1, device: str = "cpu") -> WorldBatch:
    """Create worlds of an engine, on `threads` in each of `processes`.

    ValueError for a device that the engine does not have, and for threads or processes of an engine that computes all worlds at
    once.
    """
    if engine in TOGETHER:
        if threads > 1 or processes > 1:
            raise ValueError(f"{engine}: expected one thread and one process, got {threads} and {processes}; it computes all "
                             "worlds at once")
        create: Callable[[Sequence[Scene], str], WorldBatch] = load(TOGETHER, engine)
        return create(scenes, device)
    if device != "cpu":
        raise ValueError(f"device: expected cpu with the engine {engine}, got {device!r}; only {', '.join(TOGETHER)} has another")
    return ProcessWorlds(engine, scenes, threads, processes) if processes > 1 else ThreadWorlds(engine, scenes, threads)
