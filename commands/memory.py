"""Measured memory of the stages of a run, beside the memory that they declare."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner import Graph, Runner, RunReport
from runner.selection import declarations, select_of

MARGIN = 1.25
"""factor by which the measured memory may exceed the declared one, since runs differ"""
SPARE_GIB = 0.1
"""GiB by which it may exceed it in any case: the interpreter, and what the allocator keeps"""


@dataclass(frozen=True)
class StageMemory:
    """Memory of one stage in GiB; `measured` is the largest peak of its shards, of this run and of earlier ones."""

    file: str
    declared: float
    measured: float

    @property
    def understated(self) -> bool:
        """True when the stage needs clearly more than it declares."""
        return self.measured > MARGIN * self.declared + SPARE_GIB

    def __str__(self) -> str:
        return f"{self.measured:.1f}/{self.declared:g}"


def stage_memory(runner: Runner, graph: Graph, report: RunReport) -> dict[str, StageMemory]:
    """Memory of every stage of a run with a measured shard."""
    peaks: dict[str, float] = {}
    for (stage, _), mib in report.peak_mib.items():
        peaks[stage] = max(peaks.get(stage, 0.0), mib / 1024)
    found = {}
    for node in graph.stages():
        if peaks.get(node.name):
            module = node.value.__module__
            declared = declarations(runner.modules, module, select_of(node.params))["MEMORY_GIB"]
            found[node.name] = StageMemory(f"{module.replace('.', '/')}.py", declared, peaks[node.name])
    return found


def measured_by_selection(runner: Runner) -> dict[tuple[str, str, str], float]:
    """Largest peak in GiB of the tasks in a store, by (module of the stage, parameter, its value), such as a backend."""
    found: dict[tuple[str, str, str], float] = {}
    for trace in runner.traces.all():
        module = trace.function.partition(":")[0]
        for name, value in (trace.params or {}).get("fields", {}).items():
            if isinstance(value, str):
                key = module, name, value
                found[key] = max(found.get(key, 0.0), trace.peak_rss_mib / 1024)
    return found


def show_memory_warnings(memory: Mapping[str, StageMemory], ran: Iterable[str]) -> None:
    """Print a line for each stage that ran and needed clearly more memory than it declares."""
    console = Console(stderr=True, width=None if sys.stderr.isatty() else 1000)
    for line in memory_warnings(memory, ran):
        console.print(f"[yellow]memory[/] {line}", highlight=False, soft_wrap=True)


def memory_warnings(memory: Mapping[str, StageMemory], ran: Iterable[str]) -> Iterator[str]:
    """Lines about stages that understate their memory; tasks beside them may then be killed for lack of it."""
    for stage in ran:
        found = memory.get(stage)
        if found and found.understated:
            yield (f"{stage} needed {found.measured:.1f} GiB and declares {found.declared:g}; raise MEMORY_GIB in "
                   f"{Path(found.file).as_posix()}, or lower --jobs")
