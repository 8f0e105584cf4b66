"""The desk where tasks are judged: what is the key of this shard, is its output there, and if not, why must it run?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from runner.execute import Job
from runner.graph import Node
from runner.keys import Codes, StageSpec, stage_spec, task_key
from runner.reasons import compare, keep_definitions
from runner.report import Reason
from runner.selection import selected
from runner.store import Store
from runner.traces import Traces

Path_ = tuple[str, ...]


@dataclass(frozen=True)
class Task:
    """One shard of a stage with its inputs known."""

    node: Node
    path: Path_
    spec: StageSpec
    inputs: dict[str, str]
    schemas: dict[str, str]
    key: str

    @property
    def shard(self) -> str:
        """The path as text, '' for a stage that runs once."""
        return "/".join(self.path)


class Desk:
    """Judges tasks against a store; executes nothing."""

    def __init__(self, store: Store, traces: Traces, codes: Codes, force: Iterable[str] = ()) -> None:
        self.store, self.traces = store, traces
        self._codes, self._force = codes, set(force)
        self._specs: dict[int, StageSpec] = {}
        self._kept: set[str] = set()
        self._kinds: dict[str, frozenset[str]] = {}
        self._versions: dict[str, str] = {}

    def spec(self, node: Node) -> StageSpec:
        """The stage's code, parameters and declarations."""
        if node.id not in self._specs:
            self._specs[node.id] = stage_spec(node, self._codes)
        return self._specs[node.id]

    def task(self, node: Node, path: Path_, inputs: dict[str, str]) -> Task:
        """The task and its key."""
        spec, schemas = self.spec(node), self._schemas(inputs)
        return Task(node, path, spec, inputs, schemas, task_key(spec, inputs, schemas))

    def judge(self, task: Task) -> tuple[str, Reason | None]:
        """(output, None) when it is there, ('', reason) when the task must run."""
        if task.node.name in self._force:
            return "", Reason("forced")
        output = self.traces.output(task.key)
        if output is None:
            last = self.traces.last(task.node.name, task.shard)
            return "", compare(last, task.spec, task.inputs, task.schemas, self.store.root)
        state = self.store.state(output)
        if state != "ok":  # another process may have made it anew since the index was written
            output = self.traces.reread(task.key) or output
            state = self.store.state(output)
        return (output, None) if state == "ok" else ("", Reason("output damaged" if state == "damaged" else "output lost"))

    def job(self, task: Task, reason: Reason) -> Job:
        """What a worker needs to know."""
        spec = task.spec
        if spec.code.digest not in self._kept:
            keep_definitions(self.store.root, spec)
            self._kept.add(spec.code.digest)
        return Job(
            key=task.key, stage=task.node.name, shard=task.shard, function=spec.function,
            params=selected(task.node.params, spec.blocks), params_tree=spec.params, inputs=task.inputs,
            wants_ctx=task.node.wants_ctx, code=spec.code.digest,
            schemas=task.schemas, libraries=spec.libraries, threads=spec.threads, memory_gib=spec.memory_gib,
            sources=spec.sources, reason=str(reason), force=reason.why == "forced")

    def _schemas(self, inputs: Mapping[str, str]) -> dict[str, str]:
        kinds: set[str] = set()
        for digest in inputs.values():
            if digest not in self._kinds:
                self._kinds[digest] = frozenset(self.store.kinds(digest))
            kinds |= self._kinds[digest]
        return {kind: self._version(kind) for kind in sorted(kinds)}

    def _version(self, kind: str) -> str:
        if kind not in self._versions:
            self._versions[kind] = self.store.codec.schema_version(kind)
        return self._versions[kind]
