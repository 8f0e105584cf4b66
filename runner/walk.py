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
from runner.index import no_collection
from runner.report import Reason, TaskPlan
from runner.task_planner import Demand, ShardPath, Task, TaskPlanner

FAILED, DEFERRED, UNKNOWN = "failed", "deferred", "unknown"
NO_OUTPUT = (FAILED, DEFERRED)
LOSSES = ("output lost", "output damaged", "output dropped")
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
    """State of one walk over a graph.

    `published` and measured values count as wanted: their bytes are demanded, and those of other outputs only by tasks that run.
    """

    def __init__(self, graph: Graph, wanted: list[Node], planner: TaskPlanner, listener: Listener,
                 shards: Iterable[str] = ()) -> None:
        self.graph, self.planner, self.listener = graph, planner, listener
        self.nodes = graph.upstream(wanted)
        self._targets = {node.id for node in wanted}
        self.outcome: dict[NodeShard, str] = {}
        self.remade: list[NodeShard] = []
        """withdrawn node shards that have an outcome again; whoever waits for them empties the list"""
        self.paths: dict[tuple[int, ...], dict[ShardPath, None]] = defaultdict(dict)
        self.paths[()] = {(): None}
        self._below: dict[tuple[tuple[int, ...], int], dict[ShardPath, list[ShardPath]]] = defaultdict(lambda: defaultdict(list))
        """(axes, length) -> prefix of this length -> paths"""
        self._shards = set(shards)
        self._matched: set[str] = set()
        self._seen: set[str] = set()
        self._users: dict[int, list[Node]] = defaultdict(list)
        self._sources = {node.id: [(name, source, len(graph.nodes[source].axes)) for name, source in node.inputs]
                         for node in self.nodes}
        self._collectors = {node.id: [other for other in self.nodes if other.sort == "collect"
                                      and node.id in graph.nodes[other.inputs[0][1]].axes]
                            for node in self.nodes if node.sort == "each"}
        self._expanded: dict[int, set[ShardPath]] = defaultdict(set)
        self._known: dict[int, int] = defaultdict(int)
        self._published: dict[int, int] = defaultdict(int)
        self._collected: dict[int, tuple[int, ...]] = {}
        """collect -> number of outcomes and of expanded lists from which it was made last"""
        self._attempted: dict[NodeShard, tuple[str, ...]] = {}
        self._reopened: dict[NodeShard, str] = {}
        """node shards whose outcome was withdrawn, with that outcome"""
        self._holders: dict[str, dict[NodeShard, str]] | None = None
        """artifact -> node shards whose outcome contains it, with that outcome; built when an artifact is lost"""
        self._doomed: dict[int, set[ShardPath]] = defaultdict(set)
        """node -> paths where the node, or an input of it, has failed"""
        self._queue: deque[NodeShard] = deque()
        self._dead: set[int] | None = set()
        for node in self.nodes:
            for source in dict.fromkeys(source for _, source in node.inputs):
                self._users[source].append(node)
        self.rank = self._ranks()
        self._demands = self._demanded(wanted)

    def _demanded(self, wanted: list[Node]) -> dict[int, Demand]:
        """Map each stage to the demand for the bytes of its outputs by values that are wanted, published or measured."""
        met, found = {node.id for node in self.nodes}, dict[int, Demand]()
        shown = {one.node for one in self.graph.published} | {one.node for one in self.graph.measured}
        todo: list[tuple[Node, Demand]] = [(node, True) for node in (*wanted, *(self.graph.nodes[at] for at in shown & met))]
        while todo:
            node, demand = todo.pop()
            if node.sort == "stage":
                before = found.get(node.id, False)
                found[node.id] = True if True in (before, demand) else (before or frozenset()) | (demand or frozenset())  # type: ignore[operator]
                continue
            demand = frozenset((node.value,)) if node.sort == "pick" else True
            todo += [(self.graph.nodes[source], demand) for _, source in node.inputs]
        return found

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
        doomed = len(self._doomed[user.id]) == len(self.paths[user.axes])
        return doomed and not user.partial and user.sort != "collect" and self._complete(user.axes)

    def _doom(self, node: Node, path: ShardPath) -> None:
        """Mark a failed node shard, and the shards of its users that cannot run any more."""
        for user in (node, *self._users[node.id]):
            shards, doomed = self._longer(user, path), self._doomed[user.id]
            doomed.update(shards)
            if len(doomed) == len(self.paths[user.axes]):
                self._dead = None  # to be computed again

    def _longer(self, node: Node, path: ShardPath) -> list[ShardPath]:
        """Known paths of a node that begin with `path`."""
        if len(path) == len(node.axes):
            return [path]
        return self._below[node.axes, len(path)][path]

    def begin(self) -> None:
        """Read the code of every stage, store the leafs, and propagate everything that is known."""
        with no_collection():
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
        place = node.id, path
        if place not in self.outcome:
            self._known[node.id] += 1
            if self._reopened and self._reopened.pop(place, None) is not None:
                self.remade.append(place)
        self._published[node.id] += 1
        if outcome == FAILED:
            self._doom(node, path)
        self.outcome[place] = outcome
        self._queue.append(place)
        if self._holders is not None:
            self._hold(place, outcome)

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

    def reopen(self, digest: str) -> dict[NodeShard, bool]:
        """Withdraw the outcomes that contain an unreadable artifact.

        Leafs are stored again at once. The returned node shards are stages, mapped to True where the outcome is withdrawn now:
        for these, `retry` decides again. Outcomes that follow from them stay, since a repeated stage usually gives the same bytes.
        """
        makers: dict[NodeShard, bool] = {}
        for place, held in list(self._holders_of(digest).items()):
            at, path = place
            node = self.graph.nodes[at]
            if place in self._reopened:
                makers[place] = False
            elif self.outcome.get(place) != held:
                continue
            elif node.sort == "leaf":
                self.publish(node, path, self._leaf(node))
            else:
                self._reopened[place] = self.outcome.pop(place)
                self._known[at] -= 1
                makers[place] = True
        return makers

    def _holders_of(self, digest: str) -> dict[NodeShard, str]:
        if self._holders is None:
            self._holders = defaultdict(dict)
            for place, outcome in self.outcome.items():
                self._hold(place, outcome)
        return self._holders[digest]

    def _hold(self, place: NodeShard, outcome: str) -> None:
        if outcome in NO_OUTPUT or outcome == UNKNOWN or self.graph.nodes[place[0]].sort not in ("stage", "leaf"):
            return
        assert self._holders is not None
        for inside, _ in self.planner.store.closure(outcome):
            self._holders[inside][place] = outcome

    def retry(self, node: Node, path: ShardPath) -> None:
        """Decide about a node shard again although its inputs are unchanged."""
        self._attempted.pop((node.id, path), None)
        self._attempt(node, path)

    def is_current(self, task: Task) -> bool:
        """Return True when the task has the inputs that its node shard was last attempted with."""
        return self._attempted.get((task.node.id, task.path)) == tuple(task.inputs.values())

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
            for longer in self._longer(node, path):
                self._attempt(node, longer)

    def _inputs(self, node: Node, path: ShardPath) -> dict[str, str] | None:
        """Outcomes of the inputs of a node shard; None when one is not known yet."""
        found, depth = {}, len(path)
        for name, source, length in self._sources[node.id]:
            outcome = self.outcome.get((source, path if length == depth else path[:length]))
            if outcome is None:
                return None
            found[name] = outcome
        return found

    def _attempt(self, node: Node, path: ShardPath) -> None:
        inputs = self._inputs(node, path)
        if inputs is None:
            return
        place, digests = (node.id, path), tuple(inputs.values())
        if self._attempted.get(place) == digests:
            return
        self._attempted[place] = digests
        if node.partial:
            inputs = self._available(inputs)
            digests = tuple(inputs.values())
        if FAILED in digests:
            self._blocked(node, path, inputs)
        elif DEFERRED in digests:
            if node.sort == "stage":
                self.listener.deferred(node, path)
            self.publish(node, path, DEFERRED)
        elif UNKNOWN in digests:
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
        place = task.node.id, task.path
        demand = True if place in self._reopened else self._demands.get(task.node.id, False)
        output, reason = self.planner.decide(task, demand)
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
        paths = self.paths[node.axes]
        for name, _ in kept:
            longer = *path, name
            if longer not in paths:
                paths[longer] = None
                for length in range(len(longer)):
                    self._below[node.axes, length][longer[:length]].append(longer)
        self._dead = None if self._dead is None or self._doomed else self._dead
        for name, digest in kept:
            self.publish(node, (*path, name), digest)
        for collector in self._collectors[node.id]:
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
        if self._known[source.id] < len(self.paths[source.axes]) or not self._complete(source.axes):
            return
        lists = [self.graph.nodes[axis].inputs[0][1] for axis in source.axes]
        version = (*(self._published[at] for at in (source.id, *lists)), *(len(self._expanded[axis]) for axis in source.axes))
        if self._collected.get(node.id) == version:  # the list was made after the last of its elements
            return
        self._collected[node.id] = version
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

    A task that depends on an output which does not exist yet is pending. Producers of inputs whose bytes are gone are listed before
    the task that needs them.
    """

    def __init__(self, planner: TaskPlanner) -> None:
        self._planner = planner
        self.tasks: dict[tuple[str, str], Task] = {}
        self.walk: Walk
        self._plans: dict[tuple[str, str], TaskPlan] = {}

    @property
    def plans(self) -> list[TaskPlan]:
        """One plan for each task."""
        return list(self._plans.values())

    def cached(self, task: Task, output: str) -> None:
        """Record the task with the reason of its last run."""
        why, _, detail = self._planner.index.reason(task.key).partition(": ")
        self._add(task, "cached", Reason(why, detail), output)  # type: ignore[arg-type]

    def needed(self, task: Task, reason: Reason) -> None:
        """Record that the task would run."""
        for digest in dict.fromkeys(lost for source in task.inputs.values() for lost in self._planner.store.lost(source)):
            for (at, path), withdrawn in self.walk.reopen(digest).items():
                if withdrawn:
                    self.walk.retry(self.walk.graph.nodes[at], path)
        self._add(task, "run", reason)
        same = reason.why in LOSSES  # computing it again gives the same output
        self.walk.publish(task.node, task.path, (self._planner.index.output(task.key) if same else None) or UNKNOWN)

    def blocked(self, node: Node, path: ShardPath, cause: str) -> None:
        """Raise AssertionError: nothing fails in a plan."""
        raise AssertionError(f"{node.name} {path}: {cause} failed in a plan")

    def deferred(self, node: Node, path: ShardPath) -> None:
        """Raise AssertionError: nothing is deferred in a plan."""
        raise AssertionError(f"{node.name} {path} was deferred in a plan")

    def pending(self, node: Node, path: ShardPath) -> None:
        """Record that the task may run, depending on the outputs above it."""
        shard = "/".join(path)
        self._plans[node.name, shard] = TaskPlan(node.name, shard, "pending", Reason("upstream pending"))

    def _add(self, task: Task, status: str, reason: Reason, output: str = "") -> None:
        place = task.node.name, task.shard
        self.tasks[place] = task
        self._plans[place] = TaskPlan(*place, status, reason, task.key, output)  # type: ignore[arg-type]
