"""Differences between two runs: stages whose keys differ and the parts of the keys that differ, outputs and costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from runner.differences import definition_changes, differing, pairs, parameter_changes
from runner.index import Index, Trace
from runner.run_table import Keys
from runner.task_planner import kept_definitions

COST = 0.2
"""relative change of a stage's CPU seconds that is worth a line"""
COST_S = 0.1
"""smallest change in CPU seconds that is worth a line"""


@dataclass
class StageDiff:
    """Difference of one stage between two runs, A and B."""

    stage: str
    only_a: list[str] = field(default_factory=list)
    """shards of run A alone"""
    only_b: list[str] = field(default_factory=list)
    changed: dict[str, list[str]] = field(default_factory=dict)
    """'part: detail' of the key -> shards whose keys differ in it"""
    outputs: list[str] = field(default_factory=list)
    """shards whose outputs differ"""
    cpu_s: tuple[float, float] = (0.0, 0.0)
    """CPU seconds of the shards of both runs, in A and in B"""

    @property
    def costs_differ(self) -> bool:
        """True when the CPU seconds differ by more than 20 % (and 0.1 s)."""
        a, b = self.cpu_s
        return abs(a - b) > max(COST * min(a, b), COST_S)

    @property
    def empty(self) -> bool:
        """True when the stage is the same in both runs."""
        return not (self.only_a or self.only_b or self.changed or self.outputs or self.costs_differ)


def compare_runs(a: Keys, b: Keys, traces: Index, store: Path) -> list[StageDiff]:
    """Differences by stage, in the order of the names; stages without any are omitted."""
    diffs = [_stage(name, a.get(name, {}), b.get(name, {}), traces, store) for name in sorted({*a, *b})]
    return [diff for diff in diffs if not diff.empty]


def _stage(name: str, a: Mapping[str, str], b: Mapping[str, str], traces: Index, store: Path) -> StageDiff:
    diff = StageDiff(name, sorted(a.keys() - b.keys()), sorted(b.keys() - a.keys()))
    cpu_a = cpu_b = 0.0
    for shard in sorted(shard for shard in a.keys() & b.keys() if a[shard] != b[shard]):
        old, new = traces.get(a[shard]), traces.get(b[shard])
        for part in _parts(old, new, store):
            diff.changed.setdefault(part, []).append(shard)
        if old and new:
            cpu_a, cpu_b = cpu_a + old.cpu_s, cpu_b + new.cpu_s
            if old.output != new.output:
                diff.outputs.append(shard)
    diff.cpu_s = round(cpu_a, 3), round(cpu_b, 3)
    return diff


def _parts(old: Trace | None, new: Trace | None, store: Path) -> list[str]:
    """Every part of the key that differs, as 'part: detail'."""
    if old is None or new is None:
        return ["unknown: its trace is no longer stored (gc has deleted it)"]
    found = {
        "parameters": parameter_changes(old.params, new.params) if old.params != new.params else "",
        "code": _definitions(old.code, new.code, store) if old.code != new.code else "",
        "libraries": pairs(old.libraries, new.libraries),
        "threads": f"{old.threads} -> {new.threads}" if old.threads != new.threads else "",
        "inputs": ", ".join(differing(old.inputs, new.inputs)),
        "schemas": ", ".join(differing(old.schemas, new.schemas)),
    }
    parts = [f"{name}: {detail}" for name, detail in found.items() if detail]
    return parts or [f"machine: {old.machine} -> {new.machine}"]


def _definitions(old: str, new: str, store: Path) -> str:
    return definition_changes(kept_definitions(store, old), kept_definitions(store, new))
