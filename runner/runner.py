"""The verbs: run a target, plan it, explain it; read, check and clean what is stored."""

from __future__ import annotations

import errno
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from runner import upkeep
from runner.codec import resolve
from runner.engines import Engine, Inline, Pool
from runner.execute import Place
from runner.files import FORMAT
from runner.graph import Graph, Handle, Node
from runner.keys import Codes
from runner.lease import Lease
from runner.modules import Modules
from runner.report import Failure, Observer, Reason, RunReport, Silent, TaskPlan
from runner.schedule import Budget, Limit, Schedule
from runner.signals import terminating
from runner.store import Store, StoreError, explain_os, prepare_store
from runner.task_planner import Desk, Task
from runner.traces import Traces, failures, store_format
from runner.walk import FAILED, NOTHING, Planner, Walk


class Runner:
    """A store, the code under `root`, and the means to run a graph.

    codec, worker: "module:attribute" of the Codec and of the function called as (seed, threads) before every task.
    jobs: worker processes (0: everything in this process); memory_gib: what tasks that run at once may declare together.
    schemas: packages whose doc lines do not count as code; glance: for plans, large files that were never hashed are not read.
    StoreError when `store` cannot be written to, or is of a former version.
    """

    def __init__(self, store: Path, root: Path, codec: str, worker: str | None = None, jobs: int = 1, memory_gib: float = 4.0,
                 rehash: bool = False, schemas: tuple[str, ...] = ("schemas",), glance: bool = False) -> None:
        self.root, self.place = root.absolute(), Place(store.absolute(), codec, worker, root.absolute(), schemas)
        prepare_store(self.place.store)
        _check_format(self.place.store)
        self._budget = Budget(jobs, memory_gib)
        self.store = Store(self.place.store, resolve(codec), rehash, glance)
        self.traces = Traces(self.place.store)
        self.modules = Modules(self.root, self.place.store / ".cache" / "modules.json", schemas)

    # -- run -------------------------------------------------------------------------------------------------------

    def run(self, graph: Graph, target: Any, *, shards: Iterable[str] | None = None, only: str | None = None,
            force: Iterable[str] = (), observer: Observer | None = None, limit_s: float | None = None) -> RunReport:
        """Make a target (its name, a handle, or handles). `shards` limits fan-outs to the elements named; `only` runs one
        stage on its last recorded inputs; `force` names stages to make again; `limit_s`: after so long, what the target can do
        without is left for the next run (NothingToLeaveError when there is no such thing). UnknownNameError, UnknownShardError;
        SourceError when code cannot be followed. Failures of shards are in the report, not raised.
        """
        began = time.monotonic()
        limit = Limit() if limit_s is None else self._limit(graph, target, began + limit_s)
        self._check_names(graph, [*force, *([only] if only else [])])
        report = RunReport(target if isinstance(target, str) else "")
        with self._session() as engine:
            desk = self._desk(force)
            schedule = Schedule(desk, engine, self._budget, observer or Silent(), report, limit)
            walk = Walk(graph, self._wanted(graph, target), desk, schedule, shards or ())
            schedule.walk = walk
            if only:
                self._only(graph, only, set(shards or ()), schedule, report)
            else:
                walk.begin()
                schedule.loop(walk.follow)
                walk.check_shards()
                report.failures += _unmade(walk, self._wanted(graph, target))
                report.outputs = self._outputs(graph, target, walk)
        report.seconds = time.monotonic() - began
        return report

    def plan(self, graph: Graph, target: Any, *, shards: Iterable[str] | None = None,
             force: Iterable[str] = ()) -> list[TaskPlan]:
        """What a run would do now, in the order of the graph; nothing is executed."""
        self._check_names(graph, force)
        planner = self._planned(graph, target, shards, force)
        order = {node.name: node.id for node in graph.stages()}
        return sorted(planner.plans, key=lambda plan: order[plan.stage])

    def explain(self, graph: Graph, target: Any, *, stage: str | None = None, shard: str | None = None) -> list[TaskPlan]:
        """The plan of one stage, or one shard, with the reason of every task."""
        self._check_names(graph, [stage] if stage else [])
        return [plan for plan in self.plan(graph, target)
                if stage in (None, plan.stage) and (shard is None or shard in (plan.shard, *plan.shard.split("/")))]

    # -- read ------------------------------------------------------------------------------------------------------

    def load(self, digest: str) -> Any:
        """The value of an artifact, out of verified files; LostError when one cannot be read."""
        return self.store.load(digest)

    def files(self, digest: str) -> dict[str, Path]:
        """name -> verified path of every file of a plain artifact."""
        return self.store.files(digest)

    def file(self, digest: str, name: str) -> Path:
        """The verified path of one file of a plain artifact; the others are not read."""
        return self.store.file(digest, name)

    def places(self, digest: str) -> dict[str, Path]:
        """name -> path of every file of a plain artifact, not verified."""
        return self.store.places(digest)

    def children(self, digest: str) -> list[tuple[str, str]] | None:
        """(name, digest) of the parts of a composite artifact, None for a plain one."""
        found = self.store.manifest(digest).children
        return None if found is None else list(found)

    def kind(self, digest: str) -> str:
        """The schema of an artifact."""
        return self.store.manifest(digest).kind

    def hash_file(self, path: Path) -> tuple[str, int]:
        """(digest, size in bytes) of a file outside the store, remembered by size, mtime and inode."""
        return self.store.memo.digest(path.absolute())

    def is_hashed(self, path: Path) -> bool:
        """Whether the digest of a file outside the store is remembered, so that it need not be read."""
        return self.store.memo.knows(path.absolute())

    def failures(self) -> list[dict[str, str]]:
        """key, stage, shard, message and traceback of everything that failed and has not succeeded since."""
        return failures(self.place.store)

    def lineage(self, artifact: str) -> upkeep.Origin:
        """How an artifact (digest, its beginning, or a path in the store) came to be, down to the leafs."""
        return upkeep.lineage(self.store, self.traces, artifact)

    def verify(self) -> upkeep.Verdict:
        """Hash everything again; what is damaged is moved aside, and made again by the next run."""
        return upkeep.verify(self.store, self.traces)

    def gc(self, dry_run: bool = False) -> upkeep.Swept:
        """Delete what the last use of every shard does not reach; with `dry_run`, only count it. StoreError while a run is going
        on.
        """
        lease = Lease(self.place.store / "leases" / "store.lock")
        if not lease.held:
            raise StoreError(f"a run is using {self.place.store}; collect garbage when it is over")
        try:
            self.traces = Traces(self.place.store)  # as they are now that no run can add to them
            self.store.renew()
            return upkeep.gc(self.store, self.traces, dry_run)
        finally:
            lease.release(remove=False)

    # -- private ---------------------------------------------------------------------------------------------------

    def _desk(self, force: Iterable[str]) -> Desk:
        """A desk that looks at code and store as they are now."""
        self.modules.renew()
        self.store.renew()
        self.traces.renew()
        return Desk(self.store, self.traces, Codes(self.modules, self.place.codec, self.place.worker), force)

    @contextmanager
    def _session(self) -> Iterator[Engine]:
        """An engine, the shared lease that keeps gc away, and the caches written at the end, also after Ctrl-C and SIGTERM."""
        with terminating():
            lease = self._share()
            engine: Engine = Pool(self.place) if self._budget.jobs else Inline(self.place)
            try:
                yield engine
            except StoreError:
                raise
            except OSError as error:
                raise StoreError(error.errno, f"{self.place.store} could not be read or written ({explain_os(error)}); nothing "
                                              "that was finished is lost, mend this and run again") from error
            finally:
                engine.close()
                try:
                    self._save()
                finally:
                    lease.release(remove=False)

    def _share(self) -> Lease:
        """The shared lease. What killed runs left in scratch/ and leases/ goes when no other run is open."""
        alone = Lease(self.place.store / "leases" / "store.lock")
        if alone.held:
            upkeep.sweep(self.place.store)
            alone.release(remove=False)
        while not (lease := Lease(self.place.store / "leases" / "store.lock", shared=True)).held:
            time.sleep(0.1)  # gc is at work; it is short
        return lease

    def _save(self) -> None:
        try:
            self.traces.save()
            self.store.save()
            self.modules.save()
        except OSError as error:
            raise StoreError(error.errno, f"the caches of {self.place.store} could not be written ({error}); nothing that was "
                                          "finished is lost, free some space and run again") from error

    def _planned(self, graph: Graph, target: Any, shards: Iterable[str] | None, force: Iterable[str]) -> Planner:
        desk = self._desk(force)
        planner = Planner(desk)
        planner.walk = Walk(graph, self._wanted(graph, target), desk, planner, shards or ())
        planner.walk.begin()
        if not any(plan.status != "cached" for plan in planner.plans):
            planner.walk.check_shards()
        self._save()
        return planner

    def _only(self, graph: Graph, name: str, shards: set[str], schedule: Schedule, report: RunReport) -> None:
        """Run one stage on the inputs that each of its shards had last."""
        node = next(node for node in graph.stages() if node.name == name)
        fresh = self._planned(graph, Handle(graph, node), None, ()).tasks
        made: dict[str, str] = {}
        for shard, key in sorted(self.traces.shards(name).items()):
            trace = self.traces.get(key)
            if trace is None or (shards and not shards & {shard, *shard.split("/")}):
                continue
            now = fresh.get((name, shard))
            if now is None or now.inputs != trace.inputs:
                report.stale.append(f"{name} {shard}: its recorded inputs are stale; run without --only to renew them")
            made[shard] = self._again(node, tuple(shard.split("/")) if shard else (), trace.inputs, schedule)
        if not made:
            raise UnknownNameError(f"{name} has no recorded inputs yet; run it once without --only")
        schedule.loop(lambda: None)
        outcome = schedule.walk.outcome
        report.outputs[name] = [(shard, outcome[node.id, tuple(shard.split("/")) if shard else ()]) for shard in made]
        report.outputs[name] = [(shard, digest) for shard, digest in report.outputs[name] if digest not in NOTHING]
        for part in (one for one in graph.nodes if one.sort == "pick" and one.inputs[0][1] == node.id):
            report.outputs[part.name] = [(shard, schedule.walk._field(part, digest)) for shard, digest in report.outputs[name]]

    def _again(self, node: Node, path: tuple[str, ...], inputs: dict[str, str], schedule: Schedule) -> str:
        desk = schedule.walk.desk
        task: Task = desk.task(node, path, inputs)
        output, reason = desk.judge(task)
        if reason is None:
            schedule.cached(task, output)
            schedule.walk.publish(node, path, output)
        else:
            schedule.needed(task, Reason(reason.why, reason.detail))
        return task.key

    def _limit(self, graph: Graph, target: Any, end: float) -> Limit:
        spare = graph.spare(self._wanted(graph, target))
        if not spare:
            name = target if isinstance(target, str) else "this"
            raise NothingToLeaveError(f"{name} is made whole or not at all: a run has nothing of it to leave for the next one")
        return Limit(end, spare)

    def _wanted(self, graph: Graph, target: Any) -> list[Node]:
        return [graph.node_of(handle) for handle in _handles(graph, target)]

    def _outputs(self, graph: Graph, target: Any, walk: Walk) -> dict[str, list[tuple[str, str]]]:
        met = {node.id for node in walk.nodes}
        named = [graph.nodes[one.node] for one in graph.published if one.node in met]
        return {node.name: [("/".join(path), walk.outcome[node.id, path]) for path in walk._ordered(node.axes)
                            if walk.outcome.get((node.id, path), FAILED) not in NOTHING]
                for node in (*self._wanted(graph, target), *named)}

    def _check_names(self, graph: Graph, names: Iterable[str]) -> None:
        valid = [node.name for node in graph.stages()]
        for name in names:
            if name not in valid:
                raise UnknownNameError(f"there is no stage {name!r}; the nearest are {_nearest(name, valid)}")


def _check_format(root: Path) -> None:
    """StoreError for a store of a former version: no key of it would fit, and all of it would be made again unseen."""
    found = store_format(root)
    if found not in (None, FORMAT):
        raise StoreError(errno.EINVAL, f"the store {root} is of a former version (expected {FORMAT}, got {found}), whose keys "
                                       "say where code lies; delete it, or choose another folder for the store")


def _unmade(walk: Walk, wanted: Iterable[Node]) -> list[Failure]:
    """What was wanted and has no outcome at the end of a run; there is none unless the scheduler is wrong, and then it is said."""
    return [Failure(node.name, "/".join(path), "it was not made, and nothing says why; run again, and report this as a defect")
            for node, path in walk.missing(wanted)]


class NothingToLeaveError(ValueError):
    """A run with a limit of a target that is made whole or not at all."""


class UnknownNameError(ValueError):
    """A target or stage that does not exist; the message lists the nearest ones."""


def _handles(graph: Graph, target: Any) -> tuple[Any, ...]:
    if isinstance(target, str):
        if target not in graph.targets:
            raise UnknownNameError(f"there is no target {target!r}; the nearest are {_nearest(target, list(graph.targets))}")
        return graph.targets[target]
    return tuple(target) if isinstance(target, (tuple, list)) else (target,)


def _nearest(name: str, valid: list[str]) -> str:
    return ", ".join(get_close_matches(name, valid, n=3, cutoff=0.3) or valid)
