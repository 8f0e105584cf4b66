"""Decide for each task: its key, whether its output is stored, and if not, the reason to run.

The reason is the first part of the new key, in a fixed order, that differs from the last trace of the same shard.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from runner.differences import definition_changes, differing, pairs, parameter_changes
from runner.execute import Job, JobSpec
from runner.files import DamagedError, seal, unseal, write_atomic
from runner.graph import Node
from runner.index import Index, Trace, manifest_of
from runner.keys import CodeFingerprints, StageSpec, schema_text, stage_spec, task_key
from runner.report import Reason, Why
from runner.selection import hide_unselected
from runner.store import Store

if TYPE_CHECKING:
    from runner.sharing import SharedRun

Demand = bool | frozenset[str]
"""bytes of an output that must be readable: all, none, or those of some fields of a bundle"""


def compare(last: Trace | None, spec: StageSpec, inputs: Mapping[str, str], schemas: Mapping[str, str], store: Path,
            definitions: Callable[[], dict[str, str]]) -> Reason:  # fmt: skip
    """Name the first difference from `last`: parameters, code, libraries, threads, machine, schemas, inputs."""
    if last is None:
        return Reason("first run")
    if last.params != spec.params:
        return Reason("parameter changed", parameter_changes(last.params, spec.params))
    if last.code != spec.code.digest:
        return Reason("code changed", definition_changes(kept_definitions(store, last.code), definitions()))
    if last.libraries != spec.libraries:
        return Reason("library version changed", pairs(last.libraries, spec.libraries))
    if last.threads != spec.threads:
        return Reason("threads changed", f"{last.threads} -> {spec.threads}")
    if spec.machine and last.machine != spec.machine:
        return Reason("machine changed", f"{last.machine} -> {spec.machine}")
    if last.inputs != dict(inputs):
        return Reason("input changed", ", ".join(differing(last.inputs, inputs)))
    if last.schemas != dict(schemas):
        return Reason("schema changed", ", ".join(differing(last.schemas, schemas)))
    return Reason("output lost")


def keep_definitions(store: Path, code: str, definitions: Callable[[], dict[str, str]]) -> None:
    """Store the definitions behind a fingerprint, so that `explain` can name the next change."""
    if kept_definitions(store, code) is None:
        write_atomic(store / "code" / f"{code}.json", seal(definitions(), f"code {code}"))


def kept_definitions(store: Path, code: str) -> dict[str, str] | None:
    """Definitions behind a fingerprint; None where they were not kept, or are damaged."""
    try:
        return dict(unseal((store / "code" / f"{code}.json").read_bytes(), f"code {code}"))
    except (FileNotFoundError, DamagedError):
        return None


ShardPath = tuple[str, ...]


class Task(NamedTuple):
    """One shard of a stage whose inputs are known."""

    node: Node
    path: ShardPath
    inputs: dict[str, str]
    schemas: dict[str, str]
    key: str

    @property
    def shard(self) -> str:
        """The path as text, '' for a stage that runs once."""
        return "/".join(self.path)


class TaskPlanner:
    """Computes tasks and decides whether they must run; executes nothing."""

    def __init__(self, store: Store, index: Index, codes: CodeFingerprints, force: Iterable[str] = (),
                 shared: SharedRun | None = None) -> None:
        self.store, self.index, self.shared = store, index, shared
        self._codes, self._force = codes, set(force)
        self._specs: dict[int, StageSpec] = {}
        self._jobs: dict[int, JobSpec] = {}
        self._kept: set[str] = set()
        self._unneeded: list[tuple[str, str]] = []
        """(stage, output) whose bytes are gone, and that nothing needed so far"""
        self._versions: dict[str, str] = {}
        self._schemas_of: dict[frozenset[str], tuple[dict[str, str], str]] = {}

    def spec(self, node: Node) -> StageSpec:
        """Code, parameters and declarations of a stage."""
        if node.id not in self._specs:
            self._specs[node.id] = stage_spec(node, self._codes)
        return self._specs[node.id]

    def _definitions(self, node: Node) -> dict[str, str]:
        """Definitions behind the fingerprint of a stage."""
        return self._codes.of(self.spec(node).function, node.params).definitions

    def task(self, node: Node, path: ShardPath, inputs: dict[str, str]) -> Task:
        """Build the task, with its key."""
        schemas, text = self._schemas(inputs)
        return Task(node, path, inputs, schemas, task_key(self.spec(node).digest, inputs, text))

    def refresh(self) -> None:
        """Read the results that other runs, here and on other hosts, have stored."""
        self.index.refresh()
        if self.shared is not None:
            self.shared.refresh()

    def decide(self, task: Task, demand: Demand) -> tuple[str, Reason | None]:
        """Return (output, None) if the output is known, ('', reason) if the task must run.

        Without demand for its bytes, an output counts as known although they are gone; a damaged one is repaired in any case.
        `demand` names the demanded fields of a bundle, True stands for all.
        """
        if task.node.name in self._force:
            return "", Reason("forced")
        output = self.index.output(task.key)
        if output is None:
            last = self.index.last(task.node.name, task.shard)
            return "", compare(last, self.spec(task.node), task.inputs, task.schemas, self.store.root,
                               partial(self._definitions, task.node))
        state = self.store.state(output)
        if state == "ok":
            return output, None
        why = self._loss(output, state)
        if why == "output damaged" or state == "unknown" or self._is_demanded(output, demand):
            return "", Reason(why)
        self._unneeded.append((task.node.name, output))
        return output, None

    def note_losses(self) -> None:
        """Record which outputs are gone and were not needed, so that `verify` does not report them."""
        for stage, output in self._unneeded:
            self.index.drop(stage, self.store.lost(output))
        self._unneeded.clear()

    def _is_demanded(self, output: str, demand: Demand) -> bool:
        """Return True when bytes are demanded that cannot be read."""
        if isinstance(demand, bool):
            return demand
        children = self.store.manifest(output).children or ()
        return any(self.store.state(digest) != "ok" for name, digest in children if name in demand)

    def _loss(self, output: str, state: str) -> Why:
        if state == "damaged":
            return "output damaged"
        return "output dropped" if all(digest in self.index.drops for digest in self.store.lost(output)) else "output lost"

    def job(self, task: Task, reason: Reason) -> Job:
        """Build the job that a worker executes."""
        manifests: dict[str, str] = {}
        for digest in task.inputs.values():
            self._gather(digest, manifests)
        return Job(spec=self._job_spec(task.node), key=task.key, shard=task.shard, inputs=task.inputs, schemas=task.schemas,
                   manifests=manifests, reason=str(reason), force=reason.why == "forced")

    def _gather(self, digest: str, manifests: dict[str, str]) -> None:
        """Add the manifests of an artifact and of its parts."""
        body = self.index.body(digest)
        if body is None or digest in manifests:
            return
        manifests[digest] = body
        if body[:1] == "[":
            for _, child in manifest_of(body).children or ():
                self._gather(child, manifests)

    def _job_spec(self, node: Node) -> JobSpec:
        """Part of a job that all shards of the stage share; the definitions behind its code are kept for `explain`."""
        if node.id not in self._jobs:
            spec = self.spec(node)
            if spec.code.digest not in self._kept:
                keep_definitions(self.store.root, spec.code.digest, partial(self._definitions, node))
                self._kept.add(spec.code.digest)
            self._jobs[node.id] = JobSpec(
                stage=node.name, function=spec.function, params=hide_unselected(node.params, spec.blocks), params_tree=spec.params,
                wants_ctx=node.wants_ctx, code=spec.code.digest, libraries=spec.libraries, threads=spec.threads,
                resources=spec.resources, timeout_s=spec.timeout_s, machine=spec.machine, sources=spec.sources)
        return self._jobs[node.id]

    def _schemas(self, inputs: Mapping[str, str]) -> tuple[dict[str, str], str]:
        """Schema versions of the inputs, and their text in the key."""
        found = [self.store.kinds(digest) for digest in inputs.values()]
        kinds = found[0] if len(found) == 1 else frozenset[str]().union(*found)
        known = self._schemas_of.get(kinds)
        if known is None:
            schemas = {kind: self._version(kind) for kind in sorted(kinds)}
            known = self._schemas_of[kinds] = schemas, schema_text(schemas)
        return known

    def _version(self, kind: str) -> str:
        if kind not in self._versions:
            self._versions[kind] = self.store.codec.schema_version(kind)
        return self._versions[kind]
