"""The runner's verbs: run, plan and explain a target; read, verify and clean the store."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runner import upkeep
from runner.codec import resolve
from runner.engines import Engine, Inline, Pool
from runner.execute import WorkerSpec
from runner.graph import Graph, Handle, Node
from runner.index import Index
from runner.keys import CodeFingerprints
from runner.lease import Lease
from runner.modules import Modules
from runner.report import Failure, Observer, Reason, RunReport, SilentObserver, TaskPlan
from runner.resources import Budget
from runner.schedule import Limit, Schedule
from runner.signals import terminating
from runner.store import Store, StoreError, explain_os, prepare_store
from runner.task_planner import TaskPlanner
from runner.walk import FAILED, NO_OUTPUT, PlanListener, Walk

if TYPE_CHECKING:
    from runner.disk_usage import DiskUse
    from runner.garbage import GcResult, Rules
    from runner.plan_groups import PlanGroup
    from runner.remote import Remote
    from runner.sharing import SharedRun


class Runner:
    """A store, the code under `root`, and the means to run a graph.

    codec, worker: "module:attribute" of the Codec, and of the function that is called with (seed, threads) before every task.

    jobs: worker processes (0: everything in this process); memory_gib: limit for the declared memory of concurrent tasks.

    schemas: packages whose doc lines do not count as code; plan_only: large files that were never hashed are not read.

    remote: URL of a store that several hosts share, see docs/remote.md.

    engine: called with (worker spec, offsets of the segments) for another engine than a pool of `jobs` processes.

    StoreError when `store` cannot be written to, or has a previous format; ValueError for a URL that cannot be used.
    """

    def __init__(self, store: Path, root: Path, codec: str, worker: str | None = None, jobs: int = 1, memory_gib: float = 4.0,
                 rehash: bool = False, schemas: tuple[str, ...] = ("schemas",), plan_only: bool = False,
                 remote: str | None = None, engine: Callable[..., Engine] | None = None) -> None:  # fmt: skip
        store, self.root = store.absolute(), root.absolute()
        prepare_store(store)
        self.jobs = jobs
        self._limits, self._engine = (jobs, memory_gib), engine
        self.index = Index(store)
        self._remote, self._shared = self._open(remote, store)
        self.worker_spec = WorkerSpec(store, codec, worker, self.root, schemas, remote, self.index.session,
                                      self._shared.owner if self._shared else "")
        self.store = Store(store, resolve(codec), self.index, rehash, plan_only, self._remote)
        self.modules = Modules(self.root, store / ".cache" / "modules.json", schemas)
        self._fingerprints: CodeFingerprints | None = None

    # -- run -------------------------------------------------------------------------------------------------------

    def run(self, graph: Graph, target: Any, *, shards: Iterable[str] | None = None, only: str | None = None,
            force: Iterable[str] = (), observer: Observer | None = None, limit_s: float | None = None) -> RunReport:
        """Run a target: its name, a handle, or handles.

        `shards` limits fan-outs to the named elements. `only` runs one stage on its last recorded inputs. `force` names
        stages that run even if cached. After `limit_s` seconds, optional parts of the target are deferred to the next run
        (NothingOptionalError when the target has none).

        UnknownNameError, UnknownShardError; SourceError when code cannot be followed. Failures of shards are listed in the
        report, not raised.
        """
        began = time.monotonic()
        limit = Limit() if limit_s is None else self._limit(graph, target, began + limit_s)
        self._check_names(graph, [*force, *([only] if only else [])])
        report = RunReport(target if isinstance(target, str) else "")
        observer = observer or SilentObserver()
        observer.begun(report)
        with self._session() as engine:
            planner = self._task_planner(force)
            budget = Budget(*self._limits, scratch=self.store.root / "scratch")
            schedule = Schedule(planner, engine, budget, observer, report, limit)
            walk = Walk(graph, self._wanted(graph, target), planner, schedule, shards or ())
            schedule.walk = walk
            if only:
                self._only(graph, only, set(shards or ()), schedule, report)
            else:
                walk.begin()
                schedule.loop(walk.follow)
                walk.check_shards()
                report.failures += _unmade(walk, self._wanted(graph, target))
                report.outputs = self._outputs(graph, target, walk)
            planner.note_losses()
            self._add_costs(report)
        report.seconds = time.monotonic() - began
        return report

    def plan(self, graph: Graph, target: Any, *, shards: Iterable[str] | None = None,
             force: Iterable[str] = ()) -> list[TaskPlan]:
        """List what a run would do now, in the order of the graph; nothing is executed."""
        self._check_names(graph, force)
        listener = self._planned(graph, target, shards, force)
        order = {node.name: node.id for node in graph.stages()}
        return sorted(listener.plans, key=lambda plan: order[plan.stage])

    def stale(self, graph: Graph, target: Any, *, shards: Iterable[str] | None = None) -> list[PlanGroup]:
        """List what a run would execute now, by stage, state and reason; empty when there is nothing to do."""
        from runner.plan_groups import group_plans

        return group_plans(plan for plan in self.plan(graph, target, shards=shards) if plan.status != "cached")

    def explain(self, graph: Graph, target: Any, *, stage: str | None = None, shard: str | None = None) -> list[TaskPlan]:
        """Plan one stage, or one shard, with the reason of every task."""
        self._check_names(graph, [stage] if stage else [])
        return [plan for plan in self.plan(graph, target)
                if stage in (None, plan.stage) and (shard is None or shard in (plan.shard, *plan.shard.split("/")))]

    @property
    def traces(self) -> Index:
        """Index of all traces of the store."""
        return self.index

    # -- read ------------------------------------------------------------------------------------------------------

    def load(self, digest: str) -> Any:
        """Load the value of an artifact from verified files; LostError when one cannot be read."""
        with self.reading():
            return self.store.load(digest)

    def files(self, digest: str) -> dict[str, Path]:
        """Map name to verified path for every file of a plain artifact; read them under `reading`."""
        return self.store.files(digest)

    def file(self, digest: str, name: str) -> Path:
        """Verified path of one file of a plain artifact; the other files are not read."""
        return self.store.file(digest, name)

    def unverified_files(self, digest: str) -> dict[str, Path]:
        """Map name to path for every file of a plain artifact, without verification."""
        return self.store.unverified_files(digest)

    def children(self, digest: str) -> list[tuple[str, str]] | None:
        """(name, digest) of the parts of a composite artifact, None for a plain one."""
        found = self.store.manifest(digest).children
        return None if found is None else list(found)

    def kind(self, digest: str) -> str:
        """Schema of an artifact."""
        return self.store.manifest(digest).kind

    def hash_file(self, path: Path) -> tuple[str, int]:
        """(digest, size in bytes) of a file outside the store, remembered by size, mtime and inode."""
        return self.store.memo.digest(path.absolute())

    def is_hashed(self, path: Path) -> bool:
        """Return True when the digest of a file outside the store is remembered, and the file need not be read."""
        return self.store.memo.knows(path.absolute())

    def failures(self) -> list[dict[str, str]]:
        """key, stage, shard, message and traceback of every failure without a later success."""
        return self.index.failures()

    def lineage(self, artifact: str) -> upkeep.Provenance:
        """Provenance of an artifact (digest, its prefix, or a path in the store), down to the leafs."""
        return upkeep.lineage(self.store, self.index, artifact)

    def leafs(self, artifacts: Iterable[str]) -> dict[str, frozenset[str]]:
        """Artifact -> digests of the leafs that it was computed from."""
        return upkeep.leafs(self.store, self.index, artifacts)

    def verify(self) -> upkeep.VerifyResult:
        """Hash every stored file again.

        Damaged files are moved aside, and the next run computes them again.
        """
        return upkeep.verify(self.store, self.index)

    def gc(self, dry_run: bool = False, rules: Rules | None = None) -> GcResult:
        """Delete everything that the last use of every shard does not reach, or what the rules say; with `dry_run`, only count it.

        StoreError while a run or a reader is open; UnknownStageError.
        """
        from runner import garbage  # not needed by runs, like the next import

        lease = Lease(self.store.root / "leases" / "store.lock")
        if not lease.held:
            raise StoreError(f"a run is using {self.store.root}, or a command that reads it; run gc when it has ended")
        try:
            self.index.load()  # again, now that no run can add traces
            self.store.renew()
            return garbage.collect_garbage(self.store, self.index, rules or garbage.Rules(), dry_run)
        finally:
            lease.release(remove=False)

    def disk_usage(self) -> DiskUse:
        """Disk usage by stage."""
        from runner.disk_usage import disk_usage

        with self.reading():
            return disk_usage(self.store, self.index)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Keep gc away while artifacts are read; waits for a gc that is running. Blocks may be nested."""
        lease = self._wait_for_share()
        try:
            yield
        finally:
            lease.release(remove=False)

    # -- private ---------------------------------------------------------------------------------------------------

    def _open(self, url: str | None, store: Path) -> tuple[Remote | None, SharedRun | None]:
        if url is None:
            return None, None
        from runner.remote import Remote
        from runner.sharing import SharedRun

        remote = Remote.open(url, store, session=self.index.session)
        return remote, SharedRun(remote, self.index)

    def _task_planner(self, force: Iterable[str]) -> TaskPlanner:
        """Build a planner on the current state of code and store."""
        self.modules.renew()
        self.store.renew()
        fingerprints = CodeFingerprints(self.modules, self.worker_spec.codec, self.worker_spec.worker,
                                        self.store.root / ".cache" / "specs.json")
        self._fingerprints = fingerprints
        planner = TaskPlanner(self.store, self.index, fingerprints, force, self._shared)
        planner.refresh()
        return planner

    @contextmanager
    def _session(self) -> Iterator[Engine]:
        """Open an engine under the shared lease that keeps gc away; write the caches at the end, also after Ctrl-C."""
        with terminating():
            self._join()
            lease = self._share()
            kind = self._engine or (Pool if self._limits[0] else Inline)
            engine: Engine = kind(self.worker_spec, self.index.offsets())
            try:
                yield engine
            except StoreError:
                raise
            except OSError as error:
                raise StoreError(error.errno, f"{self.store.root} could not be read or written ({explain_os(error)}); finished "
                                              "tasks are kept, fix this and run again") from error
            finally:
                engine.close()
                try:
                    if self._shared is not None:
                        self._shared.end()
                    self._save()
                finally:
                    self.index.writer.close()
                    lease.release(remove=False)

    def _join(self) -> None:
        """Register the run with the other hosts; StoreError when the remote store refuses requests."""
        if self._shared is not None:
            try:
                self._shared.begin()
            except OSError as error:
                raise StoreError(str(error)) from None

    def _share(self) -> Lease:
        """Take the shared lease.

        Leftovers of killed runs are removed, and segments mended and merged, if no other run is open.
        """
        alone = Lease(self.store.root / "leases" / "store.lock")
        if alone.held:
            upkeep.sweep(self.store.root, self.index)
            alone.release(remove=False)
        return self._wait_for_share()

    def _wait_for_share(self) -> Lease:
        """Take the shared lease, and read the index again if a gc has rewritten it."""
        while not (lease := Lease(self.store.root / "leases" / "store.lock", shared=True)).held:
            time.sleep(0.05)  # gc is running; it is short
        if self.index.outdated():
            self.index.load()
            self.store.renew()
        return lease

    def _save(self) -> None:
        try:
            self.index.save()
            self.store.save()
            self.modules.save()
            if self._fingerprints is not None:
                self._fingerprints.known.save()
        except OSError as error:
            raise StoreError(error.errno, f"the caches of {self.store.root} could not be written ({error}); finished "
                                          "tasks are kept, free some space and run again") from error

    def _planned(self, graph: Graph, target: Any, shards: Iterable[str] | None, force: Iterable[str]) -> PlanListener:
        planner = self._task_planner(force)
        listener = PlanListener(planner)
        listener.walk = Walk(graph, self._wanted(graph, target), planner, listener, shards or ())
        listener.walk.begin()
        if not any(plan.status != "cached" for plan in listener.plans):
            listener.walk.check_shards()
        self._save()
        return listener

    def _only(self, graph: Graph, name: str, shards: set[str], schedule: Schedule, report: RunReport) -> None:
        """Run one stage on the last inputs of each of its shards."""
        node = next(node for node in graph.stages() if node.name == name)
        fresh = self._planned(graph, Handle(graph, node), None, ()).tasks
        made: dict[str, str] = {}
        for shard, key in sorted(self.index.shards(name).items()):
            trace = self.index.get(key)
            if trace is None or (shards and not shards & {shard, *shard.split("/")}):
                continue
            now = fresh.get((name, shard))
            if now is None or now.inputs != trace.inputs:
                report.stale.append(f"{name} {shard}: its recorded inputs are stale; run without --only to update them")
            made[shard] = self._again(node, tuple(shard.split("/")) if shard else (), trace.inputs, schedule)
        if not made:
            raise UnknownNameError(f"{name} has no recorded inputs yet; run it once without --only")
        schedule.loop(lambda: None)
        outcome = schedule.walk.outcome
        report.outputs[name] = [(shard, outcome[node.id, tuple(shard.split("/")) if shard else ()]) for shard in made]
        report.outputs[name] = [(shard, digest) for shard, digest in report.outputs[name] if digest not in NO_OUTPUT]
        for part in (one for one in graph.nodes if one.sort == "pick" and one.inputs[0][1] == node.id):
            report.outputs[part.name] = [(shard, schedule.walk._field(part, digest)) for shard, digest in report.outputs[name]]

    def _again(self, node: Node, path: tuple[str, ...], inputs: dict[str, str], schedule: Schedule) -> str:
        planner = schedule.walk.planner
        task = planner.task(node, path, inputs)
        output, reason = planner.decide(task, True)
        if reason is None:
            schedule.cached(task, output)
            schedule.walk.publish(node, path, output)
        else:
            schedule.needed(task, Reason(reason.why, reason.detail))
        return task.key

    def _add_costs(self, report: RunReport) -> None:
        """Add CPU seconds and peak memory of all tasks that the run used."""
        for stage, shards in report.used.items():
            places = [(stage, shard) for shard in shards]
            cpu_s, peak_mib = self.index.costs(shards.values())
            report.cpu_s.update(zip(places, cpu_s, strict=True))
            report.peak_mib.update(zip(places, peak_mib, strict=True))

    def _limit(self, graph: Graph, target: Any, end: float) -> Limit:
        optional = graph.optional(self._wanted(graph, target))
        if not optional:
            name = target if isinstance(target, str) else "this"
            raise NothingOptionalError(f"{name} has no optional parts that a time limit could defer; remove --minutes")
        return Limit(end, optional)

    def _wanted(self, graph: Graph, target: Any) -> list[Node]:
        return [graph.node_of(handle) for handle in _handles(graph, target)]

    def _outputs(self, graph: Graph, target: Any, walk: Walk) -> dict[str, list[tuple[str, str]]]:
        met = {node.id for node in walk.nodes}
        named = [graph.nodes[one.node] for one in graph.published if one.node in met]
        return {node.name: [("/".join(path), walk.outcome[node.id, path]) for path in walk._ordered(node.axes)
                            if walk.outcome.get((node.id, path), FAILED) not in NO_OUTPUT]
                for node in (*self._wanted(graph, target), *named)}

    def _check_names(self, graph: Graph, names: Iterable[str]) -> None:
        valid = [node.name for node in graph.stages()]
        for name in names:
            if name not in valid:
                raise UnknownNameError(f"unknown stage {name!r}; the nearest are {_nearest(name, valid)}")


def _unmade(walk: Walk, wanted: Iterable[Node]) -> list[Failure]:
    """Failures for wanted outputs without outcome at the end of a run.

    The list is empty unless the scheduler has a defect.
    """
    return [Failure(node.name, "/".join(path), "no output and no recorded reason; run again, and report this as a defect")
            for node, path in walk.missing(wanted)]


class NothingOptionalError(ValueError):
    """A time limit was given for a target without optional parts."""


class UnknownNameError(ValueError):
    """A target or stage does not exist; the message lists the nearest ones."""


def _handles(graph: Graph, target: Any) -> tuple[Any, ...]:
    if isinstance(target, str):
        if target not in graph.targets:
            raise UnknownNameError(f"unknown target {target!r}; the nearest are {_nearest(target, list(graph.targets))}")
        return graph.targets[target]
    return tuple(target) if isinstance(target, (tuple, list)) else (target,)


def _nearest(name: str, valid: list[str]) -> str:
    return ", ".join(get_close_matches(name, valid, n=3, cutoff=0.3) or valid)
