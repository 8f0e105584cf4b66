"""Propagate outcomes down the graph, one shard at a time, with no barrier but `collect`.

A node shard is (node, path): one shard of a node. Its outcome is an artifact digest, FAILED, DEFERRED, or (in a plan) UNKNOWN. A
`Listener` handles tasks whose inputs are known, and reports their outcomes by `publish`, at once or later.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Protocol

from runner.graph import Graph, Node
from runner.report import Reason, TaskPlan
from runner.task_planner import ShardPath, Task, TaskPlanner

FAILED, DEFERRED, UNKNOWN = "failed", "deferred", "unknown"
NO_OUTPUT = (FAILED, DEFERRED)
NodeShard = tuple[int, ShardPath]


class UnknownShardError(ValueError):
    """A requested shard does not exist; the message lists the nearest ones."""


class Listener(Protocol):
    """Handles the events of node shards that are stages."""

    def cached(self, task: Task, output: str) -> None:
        """The output is stored."""

    def needed(self, task: Task, reason: Reason) -> None:
        """The task must run; a call of `publish` is expected later."""

    def blocked(self, node: Node, path: ShardPath, cause: str) -> None:
        """An input failed; `cause` names it."""

    def deferred(self, node: Node, path: ShardPath) -> None:
        """An input is deferred to another run, and so is this task."""

    def pending(self, node: Node, path: ShardPath) -> None:
        """An input is not known in this plan."""


class Walk:
    """State of one walk over a graph."""

    def __init__(self, graph: Graph, wanted: list[Node], planner: TaskPlanner, listener: Listener,
                 shards: Iterable[str] = ()) -> None:
        self.graph, self.planner, self.listener = graph, planner, listener
        self.nodes = graph.upstream(wanted)
        self._targets = {node.id for node in wanted}
        self.outcome: dict[NodeShard, str] = {}
        self.paths: dict[tuple[int, ...], dict[ShardPath, None]] = defaultdict(dict)
        self.paths[()] = {(): None}
        self._shards = set(shards)
        self._matched: set[str] = set()
        self._seen: set[str] = set()
        self._users: dict[int, list[Node]] = defaultdict(list)
        self._expanded: dict[int, set[ShardPath]] = defaultdict(set)
        self._known: dict[int, int] = defaultdict(int)
        self._attempted: dict[NodeShard, dict[str, str]] = {}
        self._reopened: dict[NodeShard, str] = {}
        """node shards whose outcome was withdrawn, with that outcome"""
        self._queue: deque[NodeShard] = deque()
        self._dead: set[int] | None = set()
        for node in self.nodes:
            for source in dict.fromkeys(source for _, source in node.inputs):
                self._users[source].append(node)
        self.rank = self._ranks()

    def _ranks(self) -> dict[int, tuple[int, int]]:
        """Priority of each node, the smallest first.

        Nodes marked with `g.first` come first. Then follow those with more collects between them and the last collect,
        because other tasks wait for the whole of such a collect. Then follow deeper nodes.
        """
        collects, depth = dict[int, int](), dict[int, int]()
        for node in reversed(self.nodes):
            ahead = (collects[user.id] + (user.sort in ("collect", "gather") and not user.axes) for user in self._users[node.id])
            collects[node.id] = max(ahead, default=0)
        for node in self.nodes:
            depth[node.id] = 1 + max((depth[source] for _, source in node.inputs), default=0)
        rank = {node.id: (-max(0, collects[node.id] - 1), -depth[node.id]) for node in self.nodes}
        return rank | {at: (-len(self.nodes), 0) for at in self.graph.priority & rank.keys()}

    @property
    def dead(self) -> set[int]:
        """Nodes whose output no task can use any more, because all its users have failed in every shard."""
        if self._dead is None:
            self._dead = set()
            for node in reversed(self.nodes):
                users = self._users[node.id]
                if node.id not in self._targets and users and all(self._is_dead(user) for user in users):
                    self._dead.add(node.id)
        return self._dead

    def _is_dead(self, user: Node) -> bool:
        """Return True when the node's output is neither computed nor wanted any more."""
        if user.id in (self._dead or ()):
            return True
        return self._complete(user.axes) and not user.partial and all(self._doomed(user, path) for path in self.paths[user.axes])

    def _doomed(self, node: Node, path: ShardPath) -> bool:
        """Return True when the node shard, or an input that it needs, has failed."""
        inputs = [self.outcome.get((source, path[: len(self.graph.nodes[source].axes)])) for _, source in node.inputs]
        return node.sort != "collect" and FAILED in (*inputs, self.outcome.get((node.id, path)))

    def begin(self) -> None:
        """Read the code of every stage, store the leafs, and propagate everything that is known."""
        for node in self.nodes:
            if node.sort == "stage":
                self.planner.spec(node)
        for node in self.nodes:
            if node.sort == "leaf":
                self.publish(node, (), self._leaf(node))
        for node in self.nodes:
            if node.sort in ("stage", "gather") and not node.inputs:
                self._attempt(node, ())
        self.follow()

    def publish(self, node: Node, path: ShardPath, outcome: str) -> None:
        """Set the outcome of a node shard; `follow` propagates it."""
        if (node.id, path) not in self.outcome:
            self._known[node.id] += 1
            self._reopened.pop((node.id, path), None)
        if outcome == FAILED:
            self._dead = None
        self.outcome[node.id, path] = outcome
        self._queue.append((node.id, path))

    def follow(self) -> None:
        """Propagate known outcomes until nothing more follows."""
        while self._queue:
            at, path = self._queue.popleft()
            for user in self._users[at] if (at, path) in self.outcome else ():  # it may have been withdrawn since
                self._notify(user, path)

    def check_shards(self) -> None:
        """Raise UnknownShardError for a requested shard that the walk has not met."""
        for name in sorted(self._shards - self._matched):
            near = get_close_matches(name, sorted(self._seen), n=3, cutoff=0.3) or sorted(self._seen)[:5]
            raise UnknownShardError(f"unknown shard {name!r}; the nearest are {', '.join(near) or 'not known'}")

    def reopen(self, digest: str) -> list[NodeShard]:
        """Withdraw the outcomes that contain an unreadable artifact.

        Leafs are stored again at once. The returned node shards are stages, for which `retry` decides again. Outcomes that
        follow from them stay, since a repeated stage usually gives the same bytes.
        """
        makers = [place for place, outcome in self._reopened.items() if self._holds(outcome, digest)]
        for (at, path), outcome in list(self.outcome.items()):
            node = self.graph.nodes[at]
            if node.sort not in ("stage", "leaf") or not self._holds(outcome, digest):
                continue
            if node.sort == "leaf":
                self.publish(node, path, self._leaf(node))
                continue
            self._reopened[at, path] = self.outcome.pop((at, path))
            self._known[at] -= 1
            makers.append((at, path))
        return makers

    def _holds(self, outcome: str, digest: str) -> bool:
        return outcome not in NO_OUTPUT and any(inside == digest for inside, _ in self.planner.store.closure(outcome))

    def restore(self) -> None:
        """Store every list of outcomes again that is missing from the store."""
        for node in self.nodes:
            for path in list(self.paths[node.axes]) if node.sort in ("collect", "gather") else ():
                outcome = self.outcome.get((node.id, path))
                if outcome not in (None, UNKNOWN, *NO_OUTPUT) and self.planner.store.find(outcome) is None:
                    self._restore_list(node, path)

    def _restore_list(self, node: Node, path: ShardPath) -> None:
        if node.sort == "collect":
            self._collect(node)
        else:
            self.planner.store.put_tuple(list(self._available(self._inputs(node, path) or {}).items()))

    def retry(self, node: Node, path: ShardPath) -> None:
        """Decide about a node shard again although its inputs are unchanged."""
        self._attempted.pop((node.id, path), None)
        self._attempt(node, path)

    def is_current(self, task: Task) -> bool:
        """Return True when the task has the inputs that its node shard was last attempted with."""
        return self._attempted.get((task.node.id, task.path)) == task.inputs

    def missing(self, wanted: Iterable[Node]) -> list[tuple[Node, ShardPath]]:
        """Wanted node shards without outcome; () stands for a whole node whose lists are not known."""
        known = [(node, path) for node in wanted for path in self.paths[node.axes] if (node.id, path) not in self.outcome]
        return known + [(node, ()) for node in wanted if not self._complete(node.axes)]

    def _leaf(self, node: Node) -> str:
        return self.planner.store.put_leaf(node.value)

    def _notify(self, node: Node, path: ShardPath) -> None:
        if node.sort == "each":
            self._expand(node, path)
        elif node.sort == "collect":
            self._collect(node)
        elif len(path) == len(node.axes):
            self._attempt(node, path)
        else:
            for longer in [p for p in self.paths[node.axes] if p[: len(path)] == path]:
                self._attempt(node, longer)

    def _inputs(self, node: Node, path: ShardPath) -> dict[str, str] | None:
        """Outcomes of the inputs of a node shard; None when one is not known yet."""
        found = {}
        for name, source in node.inputs:
            outcome = self.outcome.get((source, path[: len(self.graph.nodes[source].axes)]))
            if outcome is None:
                return None
            found[name] = outcome
        return found

    def _attempt(self, node: Node, path: ShardPath) -> None:
        inputs = self._inputs(node, path)
        if inputs is None or self._attempted.get((node.id, path)) == inputs:
            return
        self._attempted[node.id, path] = inputs
        if node.partial:
            inputs = self._available(inputs)
        if FAILED in inputs.values():
            self._blocked(node, path, inputs)
        elif DEFERRED in inputs.values():
            if node.sort == "stage":
                self.listener.deferred(node, path)
            self.publish(node, path, DEFERRED)
        elif UNKNOWN in inputs.values():
            if node.sort == "stage":
                self.listener.pending(node, path)
            self.publish(node, path, UNKNOWN)
        elif node.sort == "pick":
            self.publish(node, path, self._field(node, inputs[""]))
        elif node.sort == "gather":
            self.publish(node, path, self.planner.store.put_tuple(list(inputs.items())))
        else:
            self._decide(self.planner.task(node, path, inputs))

    def _available(self, inputs: dict[str, str]) -> dict[str, str]:
        """The inputs that have an output, possibly none; all inputs when there is none and one has failed."""
        found = {name: outcome for name, outcome in inputs.items() if outcome not in NO_OUTPUT}
        return found if found or FAILED not in inputs.values() else inputs

    def _decide(self, task: Task) -> None:
        output, reason = self.planner.decide(task)
        if reason is not None:
            self.listener.needed(task, reason)
            return
        self.listener.cached(task, output)
        self.publish(task.node, task.path, output)

    def _blocked(self, node: Node, path: ShardPath, inputs: dict[str, str]) -> None:
        if node.sort == "stage":
            cause = ", ".join(name for name, outcome in inputs.items() if outcome == FAILED)
            self.listener.blocked(node, path, cause)
        self.publish(node, path, FAILED)

    def _field(self, node: Node, digest: str) -> str:
        children = dict(self.planner.store.manifest(digest).children or ())
        if node.value not in children:
            raise ValueError(f"g.pick: {node.name} is not a part that the codec splits off; expected one of {', '.join(children)}")
        return children[node.value]

    def _expand(self, node: Node, path: ShardPath) -> None:
        """Turn the elements of a known list into shards, in order."""
        outcome = self.outcome[node.inputs[0][1], path]
        elements = [] if outcome in NO_OUTPUT else [("*", UNKNOWN)] if outcome == UNKNOWN else self._elements(node, outcome)
        siblings = {name for name, _ in elements}
        kept = [(name, digest) for name, digest in elements if self._wanted(node, path, name, siblings)]
        self._expanded[node.id].add(path)
        for name, _ in kept:
            self.paths[node.axes][*path, name] = None
        for name, digest in kept:
            self.publish(node, (*path, name), digest)
        for collector in self.nodes:
            if collector.sort == "collect" and node.id in self.graph.nodes[collector.inputs[0][1]].axes:
                self._collect(collector)

    def _elements(self, node: Node, digest: str) -> tuple[tuple[str, str], ...]:
        children = self.planner.store.manifest(digest).children
        if children is None:
            raise ValueError(f"g.each: the output of {node.name.removeprefix('each ')} is not a tuple")
        return children

    def _wanted(self, node: Node, path: ShardPath, name: str, siblings: set[str]) -> bool:
        """Return True for a selected element.

        Above a deeper fan-out, selected names that no sibling has may still occur below.
        """
        self._seen.add(name)
        self._matched |= self._shards & {name}
        if not self._shards or name == "*" or name in self._shards:
            return True
        if self._shards & set(path):
            return not self._shards & siblings
        deeper = any(other.sort == "each" and node.id in other.axes[:-1] for other in self.nodes)
        return deeper and bool(self._shards - siblings)

    def _collect(self, node: Node) -> None:
        source = self.graph.nodes[node.inputs[0][1]]
        paths = self.paths[source.axes]
        if not self._complete(source.axes) or self._known[source.id] < len(paths):
            return
        outcomes = [(path, self.outcome[source.id, path]) for path in self._ordered(source.axes)]
        if any(outcome == UNKNOWN for _, outcome in outcomes):
            self._settle(node, UNKNOWN)
            return
        good = [("/".join(path), outcome) for path, outcome in outcomes if outcome not in NO_OUTPUT]
        above = self._above(source)
        if not node.partial and DEFERRED in above.union(outcome for _, outcome in outcomes):
            self._settle(node, DEFERRED)
            return
        failed = any(outcome == FAILED for _, outcome in outcomes) or FAILED in above or bool(self._shards)
        self._settle(node, FAILED if failed and not good else self.planner.store.put_tuple(good))

    def _settle(self, node: Node, outcome: str) -> None:
        if self.outcome.get((node.id, ())) != outcome:
            self.publish(node, (), outcome)

    def _above(self, source: Node) -> set[str | None]:
        """Outcomes of the lists above."""
        return {self.outcome.get((self.graph.nodes[axis].inputs[0][1], path))
                for axis in source.axes for path in self._expanded[axis]}

    def _complete(self, axes: tuple[int, ...]) -> bool:
        return not axes or (self._complete(axes[:-1]) and len(self._expanded[axes[-1]]) == len(self.paths[axes[:-1]]))

    def _ordered(self, axes: tuple[int, ...]) -> list[ShardPath]:
        """Paths in the order of their lists, independent of the order in which they became known."""
        paths: list[ShardPath] = [()]
        for depth in range(1, len(axes) + 1):
            below: dict[ShardPath, list[ShardPath]] = defaultdict(list)
            for path in self.paths[axes[:depth]]:
                below[path[:-1]].append(path)
            paths = [longer for path in paths for longer in below[path]]
        return paths


class PlanListener:
    """Listener that records what a run would do, and executes nothing.

    A task that depends on an output which does not exist yet is pending.
    """

    def __init__(self, planner: TaskPlanner) -> None:
        self._planner = planner
        self.plans: list[TaskPlan] = []
        self.tasks: dict[tuple[str, str], Task] = {}
        self.walk: Walk

    def cached(self, task: Task, output: str) -> None:
        """Record the task with the reason of its last run."""
        trace = self._planner.traces.get(task.key)
        why, _, detail = (trace.reason if trace else "first run").partition(": ")
        self._add(task, "cached", Reason(why, detail), output)  # type: ignore[arg-type]

    def needed(self, task: Task, reason: Reason) -> None:
        """Record that the task would run."""
        self._add(task, "run", reason)
        self.walk.publish(task.node, task.path, UNKNOWN)

    def blocked(self, node: Node, path: ShardPath, cause: str) -> None:
        """Raise AssertionError: nothing fails in a plan."""
        raise AssertionError(f"{node.name} {path}: {cause} failed in a plan")

    def deferred(self, node: Node, path: ShardPath) -> None:
        """Raise AssertionError: nothing is deferred in a plan."""
        raise AssertionError(f"{node.name} {path} was deferred in a plan")

    def pending(self, node: Node, path: ShardPath) -> None:
        """Record that the task may run, depending on the outputs above it."""
        self.plans.append(TaskPlan(node.name, "/".join(path), "pending", Reason("upstream pending")))

    def _add(self, task: Task, status: str, reason: Reason, output: str = "") -> None:
        self.tasks[task.node.name, task.shard] = task
        self.plans.append(TaskPlan(task.node.name, task.shard, status, reason, task.key, output))  # type: ignore[arg-type]
