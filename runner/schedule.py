"""Schedule tasks: submit them to an engine within a budget of cores and memory, and publish their outcomes.

Tasks deep in the graph start first, so that one shard reaches the end while others are at the beginning; among equally deep tasks,
those that were known first. Tasks that an intermediate collect waits for precede them, because the tasks behind that collect are
not known yet and the cores would be idle at the end. Tasks marked with `g.first` precede all others.

A task that needs more cores or memory than are free is overtaken by a few that fit, then the scheduler waits for it. A task is
skipped once every task that would use its output has failed. When the time limit of a run is over, optional tasks are deferred to
the next run.

A task whose input cannot be read waits until the producer of the input has run again.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from runner.engines import Engine
from runner.execute import JobResult
from runner.graph import Node
from runner.report import Failure, Observer, Reason, RunReport, increment
from runner.task_planner import ShardPath, Task, TaskPlanner
from runner.walk import DEFERRED, FAILED, NodeShard, Walk

POLL_S = 0.05
MAX_RETRIES = 3
"""attempts of a task whose inputs cannot be read, or whose output another run reports but the store lacks"""
MAX_OVERTAKES = 2
"""tasks that may start, per job of the budget, while another one waits for cores or memory"""


@dataclass
class Budget:
    """Cores and memory that tasks may use at the same time."""

    jobs: int
    memory_gib: float


@dataclass(frozen=True)
class Limit:
    """End of a run, on the clock of time.monotonic, and the optional nodes that it may defer."""

    end: float = float("inf")
    optional: frozenset[int] = field(default_factory=frozenset)

    def remaining_s(self) -> float | None:
        """Seconds until the end; None without a limit, or after it."""
        left = self.end - time.monotonic()
        return left if 0 < left < float("inf") else None

    def over(self, node: Node) -> bool:
        """Return True when an optional node is too late to start."""
        return node.id in self.optional and time.monotonic() >= self.end


class Schedule:
    """Listener that runs the needed tasks."""

    def __init__(self, planner: TaskPlanner, engine: Engine, budget: Budget, observer: Observer, report: RunReport,
                 limit: Limit | None = None) -> None:
        self._planner, self._engine, self._budget, self._limit = planner, engine, budget, limit or Limit()
        self._observer, self.report = observer, report
        self._ready: list[tuple[tuple[int, int], int, Task, Reason]] = []
        self._running: dict[str, tuple[Task, Reason]] = {}
        self._parked: list[tuple[float, Task, Reason]] = []
        self._duplicates: dict[str, list[Task]] = {}
        self._heals: dict[NodeShard, int] = {}
        self._passed: dict[int, int] = {}
        """order of a ready task -> number of tasks that have overtaken it"""
        self._waiting: list[tuple[set[NodeShard], Task]] = []
        """node shards that must run again, and the task that needs their output"""
        self._planned: set[tuple[int, ShardPath]] = set()
        self._order = 0
        self.walk: Walk

    # -- events of the walk ----------------------------------------------------------------------------------------

    def cached(self, task: Task, output: str) -> None:
        """Count the task."""
        cpu_s, wall_s = self._planner.traces.cost(task.key)
        self._plan(task)
        self._finish(task, "cached", cpu_s, wall_s)

    def needed(self, task: Task, reason: Reason) -> None:
        """Queue the task until cores and memory are free."""
        self._plan(task)
        if self._limit.over(task.node):
            self._defer(task)
        else:
            self._push(task, reason)

    def blocked(self, node: Node, path: ShardPath, cause: str) -> None:
        """Count the task as blocked; the run continues."""
        shard = "/".join(path)
        increment(self.report.blocked, node.name)
        self._observer.planned(node.name, shard)
        self._observer.finished(node.name, shard, "blocked", 0.0, 0.0, f"its input {cause} failed")

    def deferred(self, node: Node, path: ShardPath) -> None:
        """Count the task as deferred to the next run."""
        shard = "/".join(path)
        increment(self.report.deferred, node.name)
        self._observer.planned(node.name, shard)
        self._observer.finished(node.name, shard, "deferred", 0.0, 0.0, "")

    def pending(self, node: Node, path: ShardPath) -> None:
        """Raise AssertionError: every input is known in a run."""
        raise AssertionError(f"{node.name} {path} has an unknown input in a run")

    # -- the loop --------------------------------------------------------------------------------------------------

    def loop(self, follow: Callable[[], None]) -> None:
        """Run until no task remains; `follow` propagates outcomes."""
        while self._ready or self._running or self._parked or self._waiting:
            self._defer_late()
            self._unpark()
            self._fill()
            patience = POLL_S if self._parked else self._limit.remaining_s()
            messages = self._engine.wait(patience) if self._running else []
            for what, key, payload in messages:
                if what == "done":
                    self._done(*self._running.pop(key), payload)
                elif key in self._running:
                    task, _ = self._running[key]
                    self._observer.progress(task.node.name, task.shard, *payload)
            if self._parked and not messages:
                time.sleep(POLL_S)
            follow()
            self._resume(follow)

    def _push(self, task: Task, reason: Reason) -> None:
        self._order += 1
        heapq.heappush(self._ready, (self.walk.rank[task.node.id], self._order, task, reason))

    def _fill(self) -> None:
        """Start whatever fits, in the order of ranks; at least one task runs, however much it requires."""
        waiting: list[tuple[tuple[int, int], int, Task, Reason]] = []
        while self._ready:
            entry = heapq.heappop(self._ready)
            _, order, task, reason = entry
            if task.node.id in self.walk.dead:
                self._drop(task)
            elif task.key in self._running:
                self._duplicates.setdefault(task.key, []).append(task)
            elif self._fits(task):
                self._start(task, reason)
                self._passed.pop(order, None)
                self._passed |= {passed: self._passed.get(passed, 0) + 1 for _, passed, _, _ in waiting}
            else:
                waiting.append(entry)
                if self._passed.get(order, 0) >= MAX_OVERTAKES * self._budget.jobs or len(waiting) > self._budget.jobs:
                    break
        for entry in waiting:
            heapq.heappush(self._ready, entry)

    def _start(self, task: Task, reason: Reason) -> None:
        self._running[task.key] = task, reason
        self._observer.started(task.node.name, task.shard, reason)
        self._engine.submit(self._planner.job(task, reason))

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

    def _defer_late(self) -> None:
        """Stop running optional tasks, and start no more of them, once the time limit is over."""
        if time.monotonic() < self._limit.end:
            return
        for task, reason in [entry for entry in self._running.values() if self._limit.over(entry[0].node)]:
            self._engine.end(task.key)
            del self._running[task.key]
            for duplicate in self._duplicates.pop(task.key, []):
                self._push(duplicate, reason)
            self._defer(task)
        late = [task for _, _, task, _ in self._ready if self._limit.over(task.node)]
        late += [task for _, task, _ in self._parked if self._limit.over(task.node)]
        gone = {id(task) for task in late}
        self._ready = [entry for entry in self._ready if id(entry[2]) not in gone]
        self._parked = [entry for entry in self._parked if id(entry[1]) not in gone]
        heapq.heapify(self._ready)
        for task in late:
            self._defer(task)

    def _drop(self, task: Task) -> None:
        """Skip a task whose users have all failed."""
        increment(self.report.blocked, task.node.name)
        self._observer.finished(task.node.name, task.shard, "blocked", 0.0, 0.0, "every task that would use its output has failed")
        self.walk.publish(task.node, task.path, FAILED)

    def _defer(self, task: Task) -> None:
        increment(self.report.deferred, task.node.name)
        self._observer.finished(task.node.name, task.shard, "deferred", 0.0, 0.0, "")
        self.walk.publish(task.node, task.path, DEFERRED)

    # -- messages of the engine ------------------------------------------------------------------------------------

    def _done(self, task: Task, reason: Reason, done: JobResult) -> None:
        for duplicate in self._duplicates.pop(task.key, []):
            self._push(duplicate, reason)
        if done.status == "ran":
            self._planner.traces.reread(task.key)
            self._planner.store.note(done.output)
            self._finish(task, "ran", done.cpu_s, done.wall_s)
            self.walk.publish(task.node, task.path, done.output)
        elif done.status == "cached":
            self._made_elsewhere(task, reason)
        elif done.status == "busy":
            self._parked.append((time.monotonic() + POLL_S, task, reason))
        elif done.status == "lost":
            self._heal(task, done)
        else:
            self._fail(task, done.message)

    def _made_elsewhere(self, task: Task, reason: Reason) -> None:
        """Take the output that another run, or the same task under another name, has stored."""
        output = self._planner.traces.reread(task.key)
        if output is not None and self._planner.store.state(output) == "ok":
            self.cached(task, output)
            self.walk.publish(task.node, task.path, output)
        elif self._again(task):
            self._push(task, reason)
        else:
            self._fail(task, f"its output was missing {MAX_RETRIES} times although a worker reported it; run again with "
                             f"--force {task.node.name}")

    def _again(self, task: Task) -> bool:
        """Return True while the task may be retried."""
        place = task.node.id, task.path
        self._heals[place] = self._heals.get(place, 0) + 1
        return self._heals[place] <= MAX_RETRIES

    def _heal(self, task: Task, done: JobResult) -> None:
        """Run the producer of an unreadable input again, then the task."""
        lost = done.message
        if not self._again(task):
            self._fail(task, f"input {lost[:12]} could not be read although it was computed again {MAX_RETRIES} times")
            return
        self._planner.store.forget(lost)
        remade = {place for places, _ in self._waiting for place in places} - self.walk.outcome.keys()
        try:
            makers = self.walk.reopen(lost)
        except OSError as error:
            self._fail(task, str(error))
            return
        self._waiting.append((set(makers), task))
        for at, path in makers:
            if (at, path) not in remade:
                self.walk.retry(self.walk.graph.nodes[at], path)

    def _resume(self, follow: Callable[[], None]) -> None:
        """Decide again about tasks whose inputs have been computed again, or have failed."""
        ready = [entry for entry in self._waiting if entry[0] <= self.walk.outcome.keys()]
        if not ready and self._waiting and not (self._ready or self._running or self._parked):
            raise AssertionError(f"{self._waiting[0][1].node.name} waits for an input that no task produces")
        self._waiting = [entry for entry in self._waiting if entry not in ready]
        if ready:
            self.walk.restore()
        for _, task in ready:
            if self.walk.is_current(task):
                self.walk.retry(task.node, task.path)
        if ready:
            follow()

    def _fail(self, task: Task, message: str) -> None:
        self.report.failures.append(Failure(task.node.name, task.shard, message, task.key))
        self._finish(task, "failed", 0.0, 0.0, message)
        self.walk.publish(task.node, task.path, FAILED)

    def _finish(self, task: Task, result: str, cpu_s: float, wall_s: float, message: str = "") -> None:
        increment(getattr(self.report, result), task.node.name)
        if result != "failed":
            self.report.cpu_s[task.node.name, task.shard] = cpu_s
            self.report.peak_mib[task.node.name, task.shard] = self._planner.traces.peak(task.key)
            self._planner.traces.use(task.node.name, task.shard, task.key)
            self.report.used.setdefault(task.node.name, {})[task.shard] = task.key
        if result == "cached":
            self._observer.cached(task.node.name, 1)
            return
        self._observer.finished(task.node.name, task.shard, result, wall_s, cpu_s, message)  # type: ignore[arg-type]

    def _plan(self, task: Task) -> None:
        if (task.node.id, task.path) not in self._planned:
            self._planned.add((task.node.id, task.path))
            self._observer.planned(task.node.name, task.shard)
