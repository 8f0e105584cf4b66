"""Summary at the end of a run: stages, failures, outputs and metrics."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from afford.extraction.sources.discover import Source
from commands.memory import StageMemory
from runner import RunReport

MANY = 200
"""limit up to which all metrics are shown; above it, those of groups and intervals are only in the report"""
PIPED_WIDTH = 1000
"""width in columns without a terminal, so that nothing is cut"""
MANY_SHARDS = 8
"""artifacts listed for one stage"""


@dataclass
class Summary:
    """JSON object that `--json` prints as the last line."""

    target: str
    ran: dict[str, int] = field(default_factory=dict)
    cached: dict[str, int] = field(default_factory=dict)
    failed: dict[str, int] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    left: dict[str, int] | None = None
    """tasks that a run with a time limit deferred; None for other runs"""
    notes: list[str] | None = None
    """partial outputs and missing recordings, with reasons"""

    def printed(self) -> str:
        """Summary as one line of JSON."""
        return json.dumps({name: value for name, value in vars(self).items() if value is not None}, sort_keys=True) + "\n"


def show_summary(summary: Summary, report: RunReport, source: Source | None,
                 memory: Mapping[str, StageMemory] | None = None) -> None:
    """Print the summary for people; `memory` by stage."""
    console = Console(stderr=True, width=None if sys.stderr.isatty() else PIPED_WIDTH)
    table = Table("stage", "ran", "cached", "failed", "CPU s", "GiB used/declared", box=None)
    for stage in _stages(summary):
        cpu = sum(seconds for (name, _), seconds in report.cpu_s.items() if name == stage)
        cells = [str(counts.get(stage, "") or "") for counts in (summary.ran, summary.cached, summary.failed)]
        table.add_row(stage, *cells, f"{cpu:.1f}", str((memory or {}).get(stage, "")))
    console.print(table)
    if source and source.missing:
        console.print(f"no video for {len(source.missing)} annotated video(s): {escape(', '.join(source.missing[:8]))}"
                      + (" ..." if len(source.missing) > 8 else ""))  # fmt: skip
    if report.deferred:
        count, stages = sum(report.deferred.values()), ", ".join(report.deferred)
        console.print(f"time is over: {count} task(s) left, of {stages}; run again to continue", highlight=False)
    for note in report.stale:
        console.print(f"[yellow]stale[/] {escape(note)}", highlight=False)
    _show_failures(console, report.failures)
    for name, path in summary.outputs.items():
        console.print(f"[bold]{name}[/] {escape(path)}", highlight=False, soft_wrap=True)
        for line in dataset_lines(Path(path)) if name == "dataset" else ():
            console.print(f"  {line}", highlight=False, soft_wrap=True)
    for note in summary.notes or ():
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    few = len(summary.metrics) <= MANY
    for name in sorted(name for name in summary.metrics if few or name.count(".") <= 1):
        console.print(f"  {name:<44} {summary.metrics[name]:.4f}", highlight=False)
    console.print(f"{summary.seconds:.1f} s")


def show_inspect_hints(report: RunReport, stages: Iterable[str]) -> None:
    """Print the commands that show outputs without a published name."""
    for stage in stages:
        made = report.outputs.get(stage, [])
        for shard, digest in made[:MANY_SHARDS]:
            sys.stderr.write(f"{stage} {shard}: python pipeline.py inspect {digest[:12]}\n")
        if len(made) > MANY_SHARDS:
            sys.stderr.write(f"and {len(made) - MANY_SHARDS} more\n")


def _stages(summary: Summary) -> Iterable[str]:
    return dict.fromkeys([*summary.cached, *summary.ran, *summary.failed])


def _show_failures(console: Console, failures: list[Any]) -> None:
    if not failures:
        return
    table = Table("stage", "clip", title="[red]failed[/]", box=None, title_justify="left")
    table.add_column("message", overflow="fold")
    for failure in failures:
        table.add_row(failure.stage, escape(failure.shard), escape(failure.message))
    console.print(table)


def dataset_lines(dataset: Path) -> Iterator[str]:
    """Samples by split and by hands, and skipped frames by reason, from the statistics of a published data set."""
    found = json.loads((dataset / "statistics.json").read_text(encoding="utf-8"))
    samples, out = found["totals"]["samples"]["here"], found["frames_without_sample"]
    yield f"{samples:,} samples of {found['videos']} video(s): {_counts(found['splits'])}"
    yield f"hands: {_counts(found['taxonomy'])}"
    yield f"frames left out: {_counts(out)}" if out else "no frame left out"


def _counts(counts: Mapping[str, int]) -> str:
    """Format counts, the largest first."""
    shown = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in shown if count)
