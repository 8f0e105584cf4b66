"""Which task comes next: outcomes flow down the graph as they become known, one shard at a time, with no barrier but `collect`.

A place is (node, path): one shard of a node. Its outcome is an artifact digest, FAILED, LATE, or (in a plan) UNKNOWN. Whoever walks
is told through a `Listener` what to do with tasks whose inputs are known; it answers, now or later, with `publish`.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Protocol

from runner.graph import Graph, Node
from runner.report import Reason, TaskPlan
from runner.task_planner import Desk, Path_, Task

FAILED, LATE, UNKNOWN = "failed", "late", "unknown"
NOTHING = (FAILED, LATE)
Place_ = tuple[int, Path_]


class UnknownShardError(ValueError):
    """A shard was asked for that does not exist; the message lists the nearest ones."""


class Listener(Protocol):
    """What happens at the places that are stages."""

    def cached(self, task: Task, output: str) -> None:
        """The output is there."""

    def needed(self, task: Task, reason: Reason) -> None:
        """The output must be made; `publish` is expected some time."""

    def blocked(self, node: Node, path: Path_, cause: str) -> None:
        """An input failed; `cause` says which."""

    def left(self, node: Node, path: Path_) -> None:
        """An input is left for another run, and so is this."""

    def pending(self, node: Node, path: Path_) -> None:
        """An input is not known in this plan."""


class Walk:
    """The state of one walk over a graph."""

    def __init__(self, graph: Graph, wanted: list[Node], desk: Desk, listener: Listener, shards: Iterable[str] = ()) -> None:
        self.graph, self.desk, self.listener = graph, desk, listener
        self.nodes = graph.upstream(wanted)
        self._targets = {node.id for node in wanted}
        self.outcome: dict[Place_, str] = {}
        self.paths: dict[tuple[int, ...], dict[Path_, None]] = defaultdict(dict)
        self.paths[()] = {(): None}
        self._shards = set(shards)
        self._met: set[str] = set()
        self._seen: set[str] = set()
        self._users: dict[int, list[Node]] = defaultdict(list)
        self._expanded: dict[int, set[Path_]] = defaultdict(set)
        self._known: dict[int, int] = defaultdict(int)
        self._asked: dict[Place_, dict[str, str]] = {}
        self._reopened: dict[Place_, str] = {}
        """places whose outcome was taken back, with that outcome"""
        self._queue: deque[Place_] = deque()
        self._useless: set[int] | None = set()
        for node in self.nodes:
            for source in dict.fromkeys(source for _, source in node.inputs):
                self._users[source].append(node)
        self.rank = self._ranks()

    def _ranks(self) -> dict[int, tuple[int, int]]:
        """Node -> how early its tasks go, the smallest first: what the graph wants first; then less the number of collects between
        it and the last one, which wait for all of it while others wait for them; then less its depth.
        """
        collects, depth = dict[int, int](), dict[int, int]()
        for node in reversed(self.nodes):
            ahead = (collects[user.id] + (user.sort in ("collect", "gather") and not user.axes) for user in self._users[node.id])
            collects[node.id] = max(ahead, default=0)
        for node in self.nodes:
            depth[node.id] = 1 + max((depth[source] for _, source in node.inputs), default=0)
        rank = {node.id: (-max(0, collects[node.id] - 1), -depth[node.id]) for node in self.nodes}
        return rank | {at: (-len(self.nodes), 0) for at in self.graph.early & rank.keys()}

    @property
    def useless(self) -> set[int]:
        """Nodes that nobody can use any more: all that would, in every shard that there is or will be, has failed."""
        if self._useless is None:
            self._useless = set()
            for node in reversed(self.nodes):
                users = self._users[node.id]
                if node.id not in self._targets and users and all(self._lost(user) for user in users):
                    self._useless.add(node.id)
        return self._useless

    def _lost(self, user: Node) -> bool:
        """Whether nothing comes of this node, or nobody wants it."""
        if user.id in (self._useless or ()):
            return True
        return self._complete(user.axes) and not user.partial and all(self._doomed(user, path) for path in self.paths[user.axes])

    def _doomed(self, node: Node, path: Path_) -> bool:
        """Whether it has failed, or what it needs has."""
        inputs = [self.outcome.get((source, path[: len(self.graph.nodes[source].axes)])) for _, source in node.inputs]
        return node.sort != "collect" and FAILED in (*inputs, self.outcome.get((node.id, path)))

    def begin(self) -> None:
        """Read the code of every stage, bring in the leafs and follow everything that is known."""
        for node in self.nodes:
            if node.sort == "stage":
                self.desk.spec(node)
        for node in self.nodes:
            if node.sort == "leaf":
                self.publish(node, (), self._leaf(node))
        for node in self.nodes:
            if node.sort in ("stage", "gather") and not node.inputs:
                self._try(node, ())
        self.follow()

    def publish(self, node: Node, path: Path_, outcome: str) -> None:
        """The outcome of a place is known; `follow` takes it further down."""
        if (node.id, path) not in self.outcome:
            self._known[node.id] += 1
            self._reopened.pop((node.id, path), None)
        if outcome == FAILED:
            self._useless = None
        self.outcome[node.id, path] = outcome
        self._queue.append((node.id, path))

    def follow(self) -> None:
        """Take known outcomes down the graph until nothing more follows."""
        while self._queue:
            at, path = self._queue.popleft()
            for user in self._users[at]:
                self._tell(user, path)

    def check_shards(self) -> None:
        """After the walk: UnknownShardError when one that was asked for does not exist."""
        for name in sorted(self._shards - self._met):
            near = get_close_matches(name, sorted(self._seen), n=3, cutoff=0.3) or sorted(self._seen)[:5]
            raise UnknownShardError(f"there is no {name!r} here; the nearest are {', '.join(near) or 'none'}")

    def reopen(self, digest: str) -> list[Place_]:
        """Take back the outcomes that hold an artifact that cannot be read. Leafs are brought in again at once; the places returned
        are stages, which `retry` judges again. What follows from them stays: most often the same bytes come back.
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
        return outcome not in NOTHING and any(inside == digest for inside, _ in self.desk.store.closure(outcome))

    def restore(self) -> None:
        """Put every list of outcomes into the store again that is not there any more."""
        for node in self.nodes:
            for path in list(self.paths[node.axes]) if node.sort in ("collect", "gather") else ():
                outcome = self.outcome.get((node.id, path))
                if outcome not in (None, UNKNOWN, *NOTHING) and self.desk.store.find(outcome) is None:
                    self._list_again(node, path)

    def _list_again(self, node: Node, path: Path_) -> None:
        if node.sort == "collect":
            self._collect(node)
        else:
            self.desk.store.put_tuple(list(self._there(self._inputs(node, path) or {}).items()))

    def retry(self, node: Node, path: Path_) -> None:
        """Judge a place again, although its inputs are what they were."""
        self._asked.pop((node.id, path), None)
        self._try(node, path)

    def asks(self, task: Task) -> bool:
        """Whether a task is the one that its place has been asked for last."""
        return self._asked.get((task.node.id, task.path)) == task.inputs

    def missing(self, wanted: Iterable[Node]) -> list[tuple[Node, Path_]]:
        """Wanted places that have no outcome; () stands for all of a node whose lists are not known."""
        known = [(node, path) for node in wanted for path in self.paths[node.axes] if (node.id, path) not in self.outcome]
        return known + [(node, ()) for node in wanted if not self._complete(node.axes)]

    def _leaf(self, node: Node) -> str:
        return self.desk.store.put_leaf(node.value)

    def _tell(self, node: Node, path: Path_) -> None:
        if node.sort == "each":
            self._expand(node, path)
        elif node.sort == "collect":
            self._collect(node)
        elif len(path) == len(node.axes):
            self._try(node, path)
        else:
            for longer in [p for p in self.paths[node.axes] if p[: len(path)] == path]:
                self._try(node, longer)

    def _inputs(self, node: Node, path: Path_) -> dict[str, str] | None:
        """Outcomes of the inputs of a place; None when one is not known yet."""
        found = {}
        for name, source in node.inputs:
            outcome = self.outcome.get((source, path[: len(self.graph.nodes[source].axes)]))
            if outcome is None:
                return None
            found[name] = outcome
        return found

    def _try(self, node: Node, path: Path_) -> None:
        inputs = self._inputs(node, path)
        if inputs is None or self._asked.get((node.id, path)) == inputs:
            return
        self._asked[node.id, path] = inputs
        if node.partial:
            inputs = self._there(inputs)
        if FAILED in inputs.values():
            self._blocked(node, path, inputs)
        elif LATE in inputs.values():
            if node.sort == "stage":
                self.listener.left(node, path)
            self.publish(node, path, LATE)
        elif UNKNOWN in inputs.values():
            if node.sort == "stage":
                self.listener.pending(node, path)
            self.publish(node, path, UNKNOWN)
        elif node.sort == "pick":
            self.publish(node, path, self._field(node, inputs[""]))
        elif node.sort == "gather":
            self.publish(node, path, self.desk.store.put_tuple(list(inputs.items())))
        else:
            self._judge(self.desk.task(node, path, inputs))

    def _there(self, inputs: dict[str, str]) -> dict[str, str]:
        """What of it could be made, which may be nothing yet; all of it when there is nothing because it failed."""
        found = {name: outcome for name, outcome in inputs.items() if outcome not in NOTHING}
        return found if found or FAILED not in inputs.values() else inputs

    def _judge(self, task: Task) -> None:
        output, reason = self.desk.judge(task)
        if reason is not None:
            self.listener.needed(task, reason)
            return
        self.listener.cached(task, output)
        self.publish(task.node, task.path, output)

    def _blocked(self, node: Node, path: Path_, inputs: dict[str, str]) -> None:
        if node.sort == "stage":
            cause = ", ".join(name for name, outcome in inputs.items() if outcome == FAILED)
            self.listener.blocked(node, path, cause)
        self.publish(node, path, FAILED)

    def _field(self, node: Node, digest: str) -> str:
        children = dict(self.desk.store.manifest(digest).children or ())
        if node.value not in children:
            raise ValueError(f"g.pick: {node.name} is no part that the codec splits off; there are: {', '.join(children)}")
        return children[node.value]

    def _expand(self, node: Node, path: Path_) -> None:
        """A list is known: its elements become places, in order."""
        outcome = self.outcome[node.inputs[0][1], path]
        elements = [] if outcome in NOTHING else [("*", UNKNOWN)] if outcome == UNKNOWN else self._elements(node, outcome)
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
        children = self.desk.store.manifest(digest).children
        if children is None:
            raise ValueError(f"g.each: the output of {node.name.removeprefix('each ')} is not a tuple")
        return children

    def _wanted(self, node: Node, path: Path_, name: str, siblings: set[str]) -> bool:
        """Whether an element is selected. Above a deeper fan-out, names that no sibling bears may still be met below."""
        self._seen.add(name)
        self._met |= self._shards & {name}
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
        good = [("/".join(path), outcome) for path, outcome in outcomes if outcome not in NOTHING]
        above = self._above(source)
        if not node.partial and LATE in above.union(outcome for _, outcome in outcomes):
            self._settle(node, LATE)
            return
        failed = any(outcome == FAILED for _, outcome in outcomes) or FAILED in above or bool(self._shards)
        self._settle(node, FAILED if failed and not good else self.desk.store.put_tuple(good))

    def _settle(self, node: Node, outcome: str) -> None:
        if self.outcome.get((node.id, ())) != outcome:
            self.publish(node, (), outcome)

    def _above(self, source: Node) -> set[str | None]:
        """Outcomes of the lists above; of one that could not be made nothing came."""
        return {self.outcome.get((self.graph.nodes[axis].inputs[0][1], path))
                for axis in source.axes for path in self._expanded[axis]}

    def _complete(self, axes: tuple[int, ...]) -> bool:
        return not axes or (self._complete(axes[:-1]) and len(self._expanded[axes[-1]]) == len(self.paths[axes[:-1]]))

    def _ordered(self, axes: tuple[int, ...]) -> list[Path_]:
        """All paths in the order of their lists, whatever the order in which they became known."""
        paths: list[Path_] = [()]
        for depth in range(1, len(axes) + 1):
            below: dict[Path_, list[Path_]] = defaultdict(list)
            for path in self.paths[axes[:depth]]:
                below[path[:-1]].append(path)
            paths = [longer for path in paths for longer in below[path]]
        return paths


class Planner:
    """The listener of a walk that only writes down."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self.plans: list[TaskPlan] = []
        self.tasks: dict[tuple[str, str], Task] = {}
        self.walk: Walk

    def cached(self, task: Task, output: str) -> None:
        """It is there; say why it ran the last time."""
        trace = self._desk.traces.get(task.key)
        why, _, detail = (trace.reason if trace else "first run").partition(": ")
        self._add(task, "cached", Reason(why, detail), output)  # type: ignore[arg-type]

    def needed(self, task: Task, reason: Reason) -> None:
        """It would run."""
        self._add(task, "run", reason)
        self.walk.publish(task.node, task.path, UNKNOWN)

    def blocked(self, node: Node, path: Path_, cause: str) -> None:
        """Nothing fails in a plan."""
        raise AssertionError(f"{node.name} {path}: {cause} failed in a plan")

    def left(self, node: Node, path: Path_) -> None:
        """Nothing is left in a plan."""
        raise AssertionError(f"{node.name} {path} was left in a plan")

    def pending(self, node: Node, path: Path_) -> None:
        """It may run, or not, according to what comes out above."""
        self.plans.append(TaskPlan(node.name, "/".join(path), "pending", Reason("upstream pending")))

    def _add(self, task: Task, status: str, reason: Reason, output: str = "") -> None:
        self.tasks[task.node.name, task.shard] = task
        self.plans.append(TaskPlan(task.node.name, task.shard, status, reason, task.key, output))  # type: ignore[arg-type]
