"""Schedule tasks: submit them to an engine within a budget of cores and memory, and publish their outcomes.

Tasks deep in the graph start first, so that one shard reaches the end while others are at the beginning; among equally deep tasks,
those that were known first. Tasks that an intermediate collect waits for precede them, because the tasks behind that collect are
not known yet and the cores would be idle at the end. Tasks marked with `g.first` precede all others.

A task that needs more cores or memory than are free is overtaken by a few that fit, then the scheduler waits for it. A task is
skipped once every task that would use its output has failed. When the time limit of a run is over, optional tasks are deferred to
the next run.

Ready tasks of one stage are sent to a worker together, as many as take about a second. The bytes of an input that are gone, or that
turn out to be unreadable, are computed again by their producer before the task that needs them starts. A task whose worker process
dies is tried once more.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from runner.engines import Engine
from runner.execute import JobResult
from runner.graph import Node
from runner.lease import KeyLeases
from runner.report import Failure, Observer, Reason, RunReport, increment
from runner.resources import Budget, Grant
from runner.task_planner import ShardPath, Task, TaskPlanner
from runner.walk import DEFERRED, FAILED, NodeShard, Walk

POLL_S = 0.05
SHARED_POLL_S = 0.5
"""time between two tries of a task that another host executes"""
BATCH_S = 1.0
"""work that is sent to a worker at a time"""
MAX_BATCH = 1000
SPREAD = 2
"""each worker gets at most this part of its share of the ready tasks at a time, so that all finish together"""
MAX_RETRIES = 3
"""attempts of a task whose inputs cannot be read, or whose output another run reports but the store lacks"""
MAX_DEATHS = 1
"""times that a task is tried again after its worker process ended"""
MAX_OVERTAKES = 2
"""batches that may start, per job of the budget, while another one waits for cores or memory"""


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


@dataclass
class _Batch:
    """Jobs that a worker executes in order, within the resources of one of them."""

    grant: Grant
    left: int


class _Pace:
    """Wall seconds per task of a stage, averaged over the tasks of this run."""

    def __init__(self) -> None:
        self.tasks, self.wall_s = 0, 0.0

    def batch(self, ready: int, workers: int) -> int:
        """Number of tasks for one dispatch; a single one until the first has been measured."""
        if not self.tasks:
            return 1
        fitting = BATCH_S / max(self.wall_s / self.tasks, BATCH_S / MAX_BATCH)
        return max(1, min(int(fitting), -(-ready // (SPREAD * max(workers, 1)))))


class _Waiting:
    """Task that waits for node shards to be computed again."""

    def __init__(self, task: Task, left: int) -> None:
        self.task, self.left = task, left


class Schedule:
    """Listener that runs the needed tasks."""

    def __init__(self, planner: TaskPlanner, engine: Engine, budget: Budget, observer: Observer, report: RunReport,
                 limit: Limit | None = None) -> None:
        self._planner, self._engine, self._budget, self._limit = planner, engine, budget, limit or Limit()
        self._observer, self.report = observer, report
        self._leases = KeyLeases(planner.store.root)
        self._ready: list[tuple[tuple[int, int], int, Task, Reason]] = []
        self._ready_of: dict[int, int] = {}
        """node -> number of its ready tasks"""
        self._running: dict[str, tuple[Task, Reason, _Batch]] = {}
        self._batches = 0
        self._paces: dict[int, _Pace] = {}
        self._parked: list[tuple[float, Task, Reason]] = []
        self._duplicates: dict[str, list[Task]] = {}
        self._executed: set[str] = set()
        """keys that this run has executed, and whose outputs are there"""
        self._heals: dict[NodeShard, int] = {}
        self._remakes: dict[str, int] = {}
        """key of a task -> number of times that its inputs were computed again"""
        self._deaths: dict[str, int] = {}
        self._passed: dict[int, int] = {}
        """order of a ready task -> number of batches that have overtaken it"""
        self._waiting: dict[NodeShard, list[_Waiting]] = {}
        """node shard that must run again -> the tasks that need its output"""
        self._hits: dict[str, int] = {}
        """cached tasks that the observer has not been informed about"""
        self._planned: set[tuple[int, ShardPath]] = set()
        self._order = 0
        self.walk: Walk

    # -- events of the walk ----------------------------------------------------------------------------------------

    def cached(self, task: Task, output: str) -> None:
        """Count the task."""
        name = task.node.name
        self._hits[name] = self._hits.get(name, 0) + 1
        increment(self.report.cached, name)
        self._use(task)

    def needed(self, task: Task, reason: Reason) -> None:
        """Queue the task until cores and memory are free, after the producers of inputs whose bytes are gone."""
        self._plan(task)
        if self._limit.over(task.node):
            self._defer(task)
            return
        lost = dict.fromkeys(digest for source in task.inputs.values() for digest in self._planner.store.lost(source))
        if not lost:
            self._push(task, reason)
        else:
            self._remake(task, lost)

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
        self._resume(follow)
        while self._ready or self._running or self._parked or self._waiting:
            self._show_hits()
            self._defer_late()
            self._unpark()
            self._fill()
            patience = POLL_S if self._parked else self._limit.remaining_s()
            messages = self._engine.wait(patience) if self._running else []
            for what, key, payload in messages:
                self._receive(what, key, payload)
            if self._parked and not messages and not self._running:
                time.sleep(POLL_S)
            follow()
            self._resume(follow)
            if not (self._ready or self._running or self._parked) and self._waiting:
                name = next(iter(self._waiting.values()))[0].task.node.name
                raise AssertionError(f"{name} waits for an input that no task produces")
        self._show_hits()
        self._leases.close()

    def _receive(self, what: str, key: str, payload: Any) -> None:
        if key not in self._running:
            return
        task, reason, _ = self._running[key]
        if what == "started":
            self._observer.started(task.node.name, task.shard, reason)
        elif what == "progress":
            self._observer.progress(task.node.name, task.shard, *payload)
        else:
            self._release(key)
            self._done(task, reason, payload)

    def _release(self, key: str) -> None:
        """Remove a running task; the last one of its batch gives its resources back."""
        _, _, batch = self._running.pop(key)
        batch.left -= 1
        if not batch.left:
            self._budget.give(batch.grant)
            self._batches -= 1

    def _show_hits(self) -> None:
        for stage, count in self._hits.items():
            self._observer.cached(stage, count)
        self._hits.clear()

    def _push(self, task: Task, reason: Reason) -> None:
        self._order += 1
        at = task.node.id
        self._ready_of[at] = self._ready_of.get(at, 0) + 1
        heapq.heappush(self._ready, (self.walk.rank[at], self._order, task, reason))

    def _pop(self) -> tuple[tuple[int, int], int, Task, Reason]:
        entry = heapq.heappop(self._ready)
        self._ready_of[entry[2].node.id] -= 1
        return entry

    def _fill(self) -> None:
        """Start whatever fits, in the order of ranks; at least one task runs, however much it requires."""
        waiting: list[tuple[tuple[int, int], int, Task, Reason]] = []
        while self._ready:
            entry = self._pop()
            _, order, task, reason = entry
            if task.node.id in self.walk.dead:
                self._drop(task)
            elif self._is_duplicate(task):
                pass
            elif self._fits(task):
                self._start(self._batch(task, reason))
                self._passed.pop(order, None)
                self._passed |= {passed: self._passed.get(passed, 0) + 1 for _, passed, _, _ in waiting}
            else:
                waiting.append(entry)
                if self._passed.get(order, 0) >= MAX_OVERTAKES * self._budget.jobs or len(waiting) > self._budget.jobs:
                    break
        for _, order, task, reason in waiting:
            self._ready_of[task.node.id] += 1
            heapq.heappush(self._ready, (self.walk.rank[task.node.id], order, task, reason))

    def _batch(self, task: Task, reason: Reason) -> list[tuple[Task, Reason]]:
        """Take further ready tasks of the stage, about a second of work in all."""
        batch, keys, node = [(task, reason)], {task.key}, task.node.id
        workers = self._engine.window if self._engine.own_placement else self._budget.jobs
        count = self._paces.setdefault(node, _Pace()).batch(self._ready_of[node] + 1, workers)
        while len(batch) < count and self._ready and self._ready[0][2].node.id == node:
            _, _, other, why = self._pop()
            if other.key in keys:
                self._duplicates.setdefault(other.key, []).append(other)
            elif not self._is_duplicate(other):
                batch.append((other, why))
                keys.add(other.key)
        return batch

    def _is_duplicate(self, task: Task) -> bool:
        """Take care of a task whose key is running, or has run since the task was queued; False for any other."""
        if task.key in self._running:
            self._duplicates.setdefault(task.key, []).append(task)
            return True
        if task.key in self._executed:
            self._executed.discard(task.key)
            self.walk.retry(task.node, task.path)
            if (task.node.id, task.path) in self.walk.outcome:  # otherwise the output is lost again, or the stage is forced
                self._executed.add(task.key)
            return True
        return False

    def _start(self, tasks: list[tuple[Task, Reason]]) -> None:
        grant = self._budget.take(self._planner.spec(tasks[0][0].node).resources)
        batch = _Batch(grant, len(tasks))
        self._batches += 1
        self._running |= {task.key: (task, reason, batch) for task, reason in tasks}
        self._engine.submit([self._planner.job(task, reason) for task, reason in tasks], grant.visible)

    def _fits(self, task: Task) -> bool:
        if self._engine.own_placement:
            return self._batches < self._engine.window
        return self._budget.fits(self._planner.spec(task.node).resources)

    def _unpark(self) -> None:
        """Queue tasks that another run executed, once their keys are free."""
        now, parked = time.monotonic(), list[tuple[float, Task, Reason]]()
        for due, task, reason in self._parked:
            if due <= now and self._leases.is_free(task.key):
                self._push(task, reason)
            else:
                parked.append((due, task, reason))
        self._parked = parked

    def _defer_late(self) -> None:
        """Stop running optional tasks, and start no more of them, once the time limit is over."""
        if time.monotonic() < self._limit.end:
            return
        for task, reason, _ in [entry for entry in self._running.values() if self._limit.over(entry[0].node)]:
            self._engine.end(task.key)
            self._release(task.key)
            for duplicate in self._duplicates.pop(task.key, []):
                self._push(duplicate, reason)
            self._defer(task)
        late = [task for _, _, task, _ in self._ready if self._limit.over(task.node)]
        for task in late:
            self._ready_of[task.node.id] -= 1
        late += [task for _, task, _ in self._parked if self._limit.over(task.node)]
        if not late:
            return
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
        if done.segment:
            self._planner.index.ingest(done.rows, done.segment, done.start)
        elif done.rows and self._planner.shared is not None:
            self._planner.shared.take(done.rows)
        duplicates = self._duplicates.pop(task.key, []) if done.status not in ("returned", "busy") else []
        if done.status == "ran":
            self._ran(task, done)
        elif done.status == "cached":
            self._made_elsewhere(task, reason)
        elif done.status == "busy":
            patience = POLL_S if self._planner.shared is None else SHARED_POLL_S
            self._parked.append((time.monotonic() + patience, task, reason))
        elif done.status == "lost":
            self._heal(task, done)
        elif done.status == "died":
            self._died(task, reason, done)
        elif done.status == "returned":
            self._push(task, reason)
        else:
            self._fail(task, done.message)
        for duplicate in duplicates:
            self.walk.retry(duplicate.node, duplicate.path)

    def _ran(self, task: Task, done: JobResult) -> None:
        pace = self._paces.setdefault(task.node.id, _Pace())
        pace.tasks += 1
        pace.wall_s += done.wall_s
        increment(self.report.ran, task.node.name)
        self._executed.add(task.key)
        self._planned.discard((task.node.id, task.path))
        self._use(task)
        self.report.peak_mib[task.node.name, task.shard] = done.peak_mib
        self._observer.finished(task.node.name, task.shard, "ran", done.wall_s, done.cpu_s, "")
        self._planner.store.forget(done.output)
        self.walk.publish(task.node, task.path, done.output)

    def _made_elsewhere(self, task: Task, reason: Reason) -> None:
        """Take the output that another run, or the same task under another name, has stored."""
        self._planner.refresh()
        output = self._planner.index.output(task.key)
        if output is not None and self._planner.store.state(output) == "ok":
            self.cached(task, output)
            self.walk.publish(task.node, task.path, output)
        elif self._again(task):
            self._push(task, reason if self._planner.shared is None else Reason("output lost"))
        else:
            self._fail(task, f"its output was missing {MAX_RETRIES} times although a worker reported it; run again with "
                             f"--force {task.node.name}")

    def _died(self, task: Task, reason: Reason, done: JobResult) -> None:
        """Try a task whose worker ended once more, unless its trace was written before."""
        self._planner.index.refresh()
        self._deaths[task.key] = self._deaths.get(task.key, 0) + 1
        output = self._planner.index.output(task.key)
        if output is not None and reason.why != "forced" and self._planner.store.state(output) == "ok":
            self.walk.retry(task.node, task.path)
        elif self._deaths[task.key] <= MAX_DEATHS:
            self._push(task, reason)
        else:
            self._fail(task, done.message)

    def _again(self, task: Task) -> bool:
        """Return True while the task may be retried."""
        place = task.node.id, task.path
        self._heals[place] = self._heals.get(place, 0) + 1
        return self._heals[place] <= MAX_RETRIES

    def _heal(self, task: Task, done: JobResult) -> None:
        """Run the producer of an unreadable input again, then the task."""
        lost = done.message.split()
        if not self._again(task):
            self._unreadable(task, lost)
            return
        self._planner.store.note_lost(lost)
        self._remake(task, lost)

    def _remake(self, task: Task, lost: Iterable[str]) -> None:
        """Run the producers of lost artifacts again; the task is decided about again after the last of them."""
        increment(self._remakes, task.key)
        if self._remakes[task.key] > MAX_RETRIES:
            self._unreadable(task, lost)
            return
        makers: dict[NodeShard, bool] = {}
        try:
            for digest in lost:
                makers = self.walk.reopen(digest) | makers
        except OSError as error:
            self._fail(task, str(error))
            return
        waiting = _Waiting(task, len(makers))
        for maker in makers:
            self._waiting.setdefault(maker, []).append(waiting)
        for (at, path), withdrawn in makers.items():
            if withdrawn:
                self.walk.retry(self.walk.graph.nodes[at], path)
        if not makers:  # only leafs, which are stored again by now
            self.walk.retry(task.node, task.path)

    def _unreadable(self, task: Task, lost: Iterable[str]) -> None:
        self._fail(task, f"input {next(iter(lost))[:12]} could not be read although it was computed again {MAX_RETRIES} times")

    def _resume(self, follow: Callable[[], None]) -> None:
        """Decide again about tasks whose inputs have been computed again, or have failed."""
        while self.walk.remade:
            places, self.walk.remade = self.walk.remade, []
            ready: list[Task] = []
            for place in places:
                for waiting in self._waiting.pop(place, []):
                    waiting.left -= 1
                    if not waiting.left:
                        ready.append(waiting.task)
            for task in ready:
                if self.walk.is_current(task):
                    self.walk.retry(task.node, task.path)
            follow()

    def _fail(self, task: Task, message: str) -> None:
        self.report.failures.append(Failure(task.node.name, task.shard, message, task.key))
        increment(self.report.failed, task.node.name)
        self._observer.finished(task.node.name, task.shard, "failed", 0.0, 0.0, message)
        self.walk.publish(task.node, task.path, FAILED)

    def _use(self, task: Task) -> None:
        """Record that the run uses the key of a task."""
        shard = task.shard
        self.report.used.setdefault(task.node.name, {})[shard] = task.key
        self._planner.index.use(task.node.name, shard, task.key)

    def _plan(self, task: Task) -> None:
        if (task.node.id, task.path) not in self._planned:
            self._planned.add((task.node.id, task.path))
            self._observer.planned(task.node.name, task.shard)
