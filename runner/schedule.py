"""A run: tasks that must be made go to an engine within a budget of cores and memory, and what they make goes back to the walk.

Tasks deep in the graph go first, so that one shard reaches the end while others are still at the beginning; of equally deep ones,
those that were known first. Before them go tasks that a collect waits for, other than the last: what uses it is not known yet, and
the cores would have too little to do in the end. Before all others go those that the graph wants first. A task that needs more
cores or memory than are free is overtaken by a few that fit, then waits alone for what it needs. What no task can use any more,
because all that would has failed, is not made. When the time of a run with a limit is over, what the target can do without is left
for the next run.

A task whose input cannot be read waits until what made the input has run again.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from runner.engines import Engine
from runner.execute import Done
from runner.graph import Node
from runner.report import Failure, Observer, Reason, RunReport, count
from runner.task_planner import Desk, Path_, Task
from runner.walk import FAILED, LATE, Place_, Walk

PATIENCE_S = 0.05
HEALS = 3
"""so often is a task given new inputs when those it has cannot be read, or looked up again when its output was made elsewhere"""
OVERTAKEN = 2
"""so often may others start, per job of the budget, while a task waits for cores or memory"""


@dataclass
class Budget:
    """Cores and memory of the machine that may be used at once."""

    jobs: int
    memory_gib: float


@dataclass(frozen=True)
class Limit:
    """When a run is to end, on the clock of time.monotonic, and the nodes that can then be left for another one."""

    end: float = float("inf")
    spare: frozenset[int] = field(default_factory=frozenset)

    def left_s(self) -> float | None:
        """How long until then; None when there is no limit, or it is over."""
        left = self.end - time.monotonic()
        return left if 0 < left < float("inf") else None

    def over(self, node: Node) -> bool:
        """Whether it is too late for this one."""
        return node.id in self.spare and time.monotonic() >= self.end


class Schedule:
    """The listener of a walk that makes what is needed."""

    def __init__(self, desk: Desk, engine: Engine, budget: Budget, observer: Observer, report: RunReport,
                 limit: Limit | None = None) -> None:
        self._desk, self._engine, self._budget, self._limit = desk, engine, budget, limit or Limit()
        self._observer, self.report = observer, report
        self._ready: list[tuple[tuple[int, int], int, Task, Reason]] = []
        self._running: dict[str, tuple[Task, Reason]] = {}
        self._parked: list[tuple[float, Task, Reason]] = []
        self._twins: dict[str, list[Task]] = {}
        self._heals: dict[Place_, int] = {}
        self._passed: dict[int, int] = {}
        """order of a ready task -> how many have started in its place"""
        self._waiting: list[tuple[set[Place_], Task]] = []
        """places that make something again, and a task that needs it"""
        self._planned: set[tuple[int, Path_]] = set()
        self._order = 0
        self.walk: Walk

    # -- what the walk says ----------------------------------------------------------------------------------------

    def cached(self, task: Task, output: str) -> None:
        """Nothing to do but to count."""
        cpu_s, wall_s = self._desk.traces.cost(task.key)
        self._plan(task)
        self._finish(task, "cached", cpu_s, wall_s)

    def needed(self, task: Task, reason: Reason) -> None:
        """Keep it until cores and memory allow."""
        self._plan(task)
        if self._limit.over(task.node):
            self._leave(task)
        else:
            self._push(task, reason)

    def blocked(self, node: Node, path: Path_, cause: str) -> None:
        """It cannot run; the run goes on."""
        shard = "/".join(path)
        count(self.report.blocked, node.name)
        self._observer.planned(node.name, shard)
        self._observer.finished(node.name, shard, "blocked", 0.0, 0.0, f"its input {cause} could not be made")

    def left(self, node: Node, path: Path_) -> None:
        """It is for the next run."""
        shard = "/".join(path)
        count(self.report.left, node.name)
        self._observer.planned(node.name, shard)
        self._observer.finished(node.name, shard, "left", 0.0, 0.0, "")

    def pending(self, node: Node, path: Path_) -> None:
        """Never in a run: every input is made."""
        raise AssertionError(f"{node.name} {path} has an unknown input in a run")

    # -- the loop --------------------------------------------------------------------------------------------------

    def loop(self, follow: Callable[[], None]) -> None:
        """Until nothing is left to do; `follow` takes outcomes down the graph."""
        while self._ready or self._running or self._parked or self._waiting:
            self._leave_late()
            self._unpark()
            self._fill()
            patience = PATIENCE_S if self._parked else self._limit.left_s()
            messages = self._engine.wait(patience) if self._running else []
            for what, key, said in messages:
                if what == "done":
                    self._done(*self._running.pop(key), said)
                elif key in self._running:
                    task, _ = self._running[key]
                    self._observer.progress(task.node.name, task.shard, *said)
            if self._parked and not messages:
                time.sleep(PATIENCE_S)
            follow()
            self._resume(follow)

    def _push(self, task: Task, reason: Reason) -> None:
        self._order += 1
        heapq.heappush(self._ready, (self.walk.rank[task.node.id], self._order, task, reason))

    def _fill(self) -> None:
        """Start whatever fits, in the order of ranks; something always runs, however much it asks for."""
        waiting: list[tuple[tuple[int, int], int, Task, Reason]] = []
        while self._ready:
            entry = heapq.heappop(self._ready)
            _, order, task, reason = entry
            if task.node.id in self.walk.useless:
                self._drop(task)
            elif task.key in self._running:
                self._twins.setdefault(task.key, []).append(task)
            elif self._fits(task):
                self._start(task, reason)
                self._passed.pop(order, None)
                self._passed |= {passed: self._passed.get(passed, 0) + 1 for _, passed, _, _ in waiting}
            else:
                waiting.append(entry)
                if self._passed.get(order, 0) >= OVERTAKEN * self._budget.jobs or len(waiting) > self._budget.jobs:
                    break
        for entry in waiting:
            heapq.heappush(self._ready, entry)

    def _start(self, task: Task, reason: Reason) -> None:
        self._running[task.key] = task, reason
        self._observer.started(task.node.name, task.shard, reason)
        self._engine.submit(self._desk.job(task, reason))

    def _fits(self, task: Task) -> bool:
        specs = [running.spec for running, _ in self._running.values()]
        cores = sum(spec.threads for spec in specs) + task.spec.threads
        memory = sum(spec.memory_gib for spec in specs) + task.spec.memory_gib
        return not specs or (cores <= self._budget.jobs and memory <= self._budget.memory_gib)

    def _unpark(self) -> None:
        now = time.monotonic()
        due = [entry for entry in self._parked if entry[0] <= now]
        self._parked = [entry for entry in self._parked if entry[0] > now]
        for _, task, reason in due:
            self._push(task, reason)

    def _leave_late(self) -> None:
        """Once the time is over: stop what the target can do without, and begin no more of it."""
        if time.monotonic() < self._limit.end:
            return
        for task, reason in [entry for entry in self._running.values() if self._limit.over(entry[0].node)]:
            self._engine.end(task.key)
            del self._running[task.key]
            for twin in self._twins.pop(task.key, []):
                self._push(twin, reason)
            self._leave(task)
        late = [task for _, _, task, _ in self._ready if self._limit.over(task.node)]
        late += [task for _, task, _ in self._parked if self._limit.over(task.node)]
        gone = {id(task) for task in late}
        self._ready = [entry for entry in self._ready if id(entry[2]) not in gone]
        self._parked = [entry for entry in self._parked if id(entry[1]) not in gone]
        heapq.heapify(self._ready)
        for task in late:
            self._leave(task)

    def _drop(self, task: Task) -> None:
        """All that would use it has failed."""
        count(self.report.blocked, task.node.name)
        self._observer.finished(task.node.name, task.shard, "blocked", 0.0, 0.0, "nothing is left that could use it")
        self.walk.publish(task.node, task.path, FAILED)

    def _leave(self, task: Task) -> None:
        count(self.report.left, task.node.name)
        self._observer.finished(task.node.name, task.shard, "left", 0.0, 0.0, "")
        self.walk.publish(task.node, task.path, LATE)

    # -- what an engine says ---------------------------------------------------------------------------------------

    def _done(self, task: Task, reason: Reason, done: Done) -> None:
        for twin in self._twins.pop(task.key, []):
            self._push(twin, reason)
        if done.status == "ran":
            self._desk.traces.reread(task.key)
            self._desk.store.note(done.output)
            self._finish(task, "ran", done.cpu_s, done.wall_s)
            self.walk.publish(task.node, task.path, done.output)
        elif done.status == "cached":
            self._made_elsewhere(task, reason)
        elif done.status == "busy":
            self._parked.append((time.monotonic() + PATIENCE_S, task, reason))
        elif done.status == "lost":
            self._heal(task, done)
        else:
            self._fail(task, done.message)

    def _made_elsewhere(self, task: Task, reason: Reason) -> None:
        """Another run, or a twin under another name, was faster."""
        output = self._desk.traces.reread(task.key)
        if output is not None and self._desk.store.state(output) == "ok":
            self.cached(task, output)
            self.walk.publish(task.node, task.path, output)
        elif self._again(task):
            self._push(task, reason)
        else:
            self._fail(task, f"its output was not found {HEALS} times, although a worker reports it made; run again with --force "
                             f"{task.node.name}")

    def _again(self, task: Task) -> bool:
        """Whether a task may be tried once more."""
        place = task.node.id, task.path
        self._heals[place] = self._heals.get(place, 0) + 1
        return self._heals[place] <= HEALS

    def _heal(self, task: Task, done: Done) -> None:
        """An input cannot be read: what made it runs again, then this task does."""
        lost = done.message
        if not self._again(task):
            self._fail(task, f"an input ({lost[:12]}) could not be read, although it was made again {HEALS} times")
            return
        self._desk.store.forget(lost)
        try:
            makers = self.walk.reopen(lost)
        except OSError as error:
            self._fail(task, str(error))
            return
        remade = {place for places, _ in self._waiting for place in places} - self.walk.outcome.keys()
        self._waiting.append((set(makers), task))
        for at, path in makers:
            if (at, path) not in remade:
                self.walk.retry(self.walk.graph.nodes[at], path)

    def _resume(self, follow: Callable[[], None]) -> None:
        """Judge the tasks again whose inputs have been made again, or have failed."""
        ready = [entry for entry in self._waiting if entry[0] <= self.walk.outcome.keys()]
        if not ready and self._waiting and not (self._ready or self._running or self._parked):
            raise AssertionError(f"{self._waiting[0][1].node.name} waits for an input that no task makes")
        self._waiting = [entry for entry in self._waiting if entry not in ready]
        if ready:
            self.walk.restore()
        for _, task in ready:
            if self.walk.asks(task):
                self.walk.retry(task.node, task.path)
        if ready:
            follow()

    def _fail(self, task: Task, message: str) -> None:
        self.report.failures.append(Failure(task.node.name, task.shard, message, task.key))
        self._finish(task, "failed", 0.0, 0.0, message)
        self.walk.publish(task.node, task.path, FAILED)

    def _finish(self, task: Task, result: str, cpu_s: float, wall_s: float, message: str = "") -> None:
        count(getattr(self.report, result), task.node.name)
        if result != "failed":
            self.report.cpu_s[task.node.name, task.shard] = cpu_s
            self.report.peak_mib[task.node.name, task.shard] = self._desk.traces.peak(task.key)
            self._desk.traces.use(task.node.name, task.shard, task.key)
        self._observer.finished(task.node.name, task.shard, result, wall_s, cpu_s, message)  # type: ignore[arg-type]

    def _plan(self, task: Task) -> None:
        if (task.node.id, task.path) not in self._planned:
            self._planned.add((task.node.id, task.path))
            self._observer.planned(task.node.name, task.shard)
