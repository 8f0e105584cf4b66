"""Decide for each task: its key, whether its output is stored, and if not, the reason to run.

The reason is the first part of the new key, in a fixed order, that differs from the last trace of the same shard.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner.execute import Job
from runner.files import DamagedError, seal, unseal, write_atomic
from runner.fingerprint import changed
from runner.graph import Node
from runner.keys import CodeFingerprints, StageSpec, stage_spec, task_key
from runner.report import Reason
from runner.selection import hide_unselected
from runner.store import Store
from runner.traces import Trace, Traces

SHOWN = 3


def compare(last: Trace | None, spec: StageSpec, inputs: Mapping[str, str], schemas: Mapping[str, str], store: Path) -> Reason:
    """Name the first difference from `last`: parameters, code, libraries, threads, machine, schemas, inputs."""
    if last is None:
        return Reason("first run")
    if last.params != spec.params:
        return Reason("parameter changed", _params(last.params, spec.params))
    if last.code != spec.code.digest:
        return Reason("code changed", _code(last, spec, store))
    if last.libraries != spec.libraries:
        return Reason("library version changed", _pairs(last.libraries, spec.libraries))
    if last.threads != spec.threads:
        return Reason("threads changed", f"{last.threads} -> {spec.threads}")
    if spec.machine and last.machine != spec.machine:
        return Reason("machine changed", f"{last.machine} -> {spec.machine}")
    if last.inputs != dict(inputs):
        return Reason("input changed", ", ".join(_differing(last.inputs, inputs)))
    if last.schemas != dict(schemas):
        return Reason("schema changed", ", ".join(_differing(last.schemas, schemas)))
    return Reason("output lost")


def keep_definitions(store: Path, spec: StageSpec) -> None:
    """Store the definitions behind a fingerprint, so that `explain` can name the next change."""
    if kept_definitions(store, spec.code.digest) is None:
        write_atomic(store / "code" / f"{spec.code.digest}.json", seal(spec.code.definitions, f"code {spec.code.digest}"))


def kept_definitions(store: Path, code: str) -> dict[str, str] | None:
    """Definitions behind a fingerprint; None where they were not kept, or are damaged."""
    try:
        return dict(unseal((store / "code" / f"{code}.json").read_bytes(), f"code {code}"))
    except (FileNotFoundError, DamagedError):
        return None


def _code(last: Trace, spec: StageSpec, store: Path) -> str:
    old = kept_definitions(store, last.code)
    if old is None:
        return "the previous definitions were not kept"
    names = changed(old, spec.code.definitions)
    if not names:
        return "same definitions, reached through other names"
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _params(old: Any, new: Any) -> str:
    return _pairs(_flat(old), _flat(new))


def _flat(tree: Any) -> dict[str, Any]:
    """Parameters by name; those of a block as 'block.name'."""
    found: dict[str, Any] = {}
    for name, value in tree["fields"].items() if tree else ():
        is_block = isinstance(value, dict) and "fields" in value
        found |= {f"{name}.{inner}": part for inner, part in _flat(value).items()} if is_block else {name: value}
    return found


def _pairs(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_show(old, name)} -> {_show(new, name)}" for name in _differing(old, new))


def _show(table: Mapping[str, Any], name: str) -> str:
    return json.dumps(table[name]) if name in table else "(none)"


def _differing(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    return [name for name in sorted({*old, *new}) if (name in old) != (name in new) or old.get(name) != new.get(name)]


ShardPath = tuple[str, ...]


@dataclass(frozen=True)
class Task:
    """One shard of a stage whose inputs are known."""

    node: Node
    path: ShardPath
    spec: StageSpec
    inputs: dict[str, str]
    schemas: dict[str, str]
    key: str

    @property
    def shard(self) -> str:
        """The path as text, '' for a stage that runs once."""
        return "/".join(self.path)


class TaskPlanner:
    """Computes tasks and decides whether they must run; executes nothing."""

    def __init__(self, store: Store, traces: Traces, codes: CodeFingerprints, force: Iterable[str] = ()) -> None:
        self.store, self.traces = store, traces
        self._codes, self._force = codes, set(force)
        self._specs: dict[int, StageSpec] = {}
        self._kept: set[str] = set()
        self._kinds: dict[str, frozenset[str]] = {}
        self._versions: dict[str, str] = {}

    def spec(self, node: Node) -> StageSpec:
        """Code, parameters and declarations of a stage."""
        if node.id not in self._specs:
            self._specs[node.id] = stage_spec(node, self._codes)
        return self._specs[node.id]

    def task(self, node: Node, path: ShardPath, inputs: dict[str, str]) -> Task:
        """Build the task, with its key."""
        spec, schemas = self.spec(node), self._schemas(inputs)
        return Task(node, path, spec, inputs, schemas, task_key(spec, inputs, schemas))

    def decide(self, task: Task) -> tuple[str, Reason | None]:
        """Return (output, None) if the output is stored, ('', reason) if the task must run."""
        if task.node.name in self._force:
            return "", Reason("forced")
        output = self.traces.output(task.key)
        if output is None:
            last = self.traces.last(task.node.name, task.shard)
            return "", compare(last, task.spec, task.inputs, task.schemas, self.store.root)
        state = self.store.state(output)
        if state != "ok":  # another process may have stored the output again since the index was written
            output = self.traces.reread(task.key) or output
            state = self.store.state(output)
        return (output, None) if state == "ok" else ("", Reason("output damaged" if state == "damaged" else "output lost"))

    def job(self, task: Task, reason: Reason) -> Job:
        """Build the job that a worker executes."""
        spec = task.spec
        if spec.code.digest not in self._kept:
            keep_definitions(self.store.root, spec)
            self._kept.add(spec.code.digest)
        return Job(
            key=task.key, stage=task.node.name, shard=task.shard, function=spec.function,
            params=hide_unselected(task.node.params, spec.blocks), params_tree=spec.params, inputs=task.inputs,
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
