"""Verbs about past runs and the next one: runs, runs diff, runs timeline, stale."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from rich.markup import escape

from commands.errors import UsageError
from commands.session import existing_store, open_existing, open_runner
from commands.tables import console, plain_table, print_json
from runner.log_file import BrokenLogError
from runner.past_runs import RunRecord, UnknownRunError, find_run, list_runs, run_paths
from runner.run_table import LostTableError

T = TypeVar("T")
RESULTS = ("ran", "cached", "failed", "blocked", "deferred")
SHOWN = 3
"""shards that a line names"""


def runs(store: Path | None, count: int, as_json: bool) -> int:
    """List the last `count` runs, the newest first."""
    folder = existing_store(store)
    found = list_runs(folder, count)
    if as_json:
        print_json({"runs": [_as_json(run) for run in found]})
        return 0
    if not found:
        sys.stdout.write("no recorded run yet\n")
        return 0
    table = plain_table("id", "when", "target", "source", "outcome", "ran", "cached", "failed", "CPU s", "seconds")
    for run in found:
        counts = (str(run.count(result) or "") for result in ("ran", "cached", "failed"))
        table.add_row(run.id, when(run.began), run.target, escape(str(run.settings.get("source") or "")), _coloured(run.outcome),
                      *counts, f"{run.cpu_s:.1f}", f"{run.seconds:.1f}")
    console().print(table)
    more = len(run_paths(folder)) - len(found)
    if more > 0:
        sys.stdout.write(f"and {more} earlier run(s); -n lists more\n")
    return 0


def when(seconds: float) -> str:
    """Local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def _coloured(outcome: str) -> str:
    colour = {"ok": "green", "running": "green"}.get(outcome, "red")
    return f"[{colour}]{outcome}[/]"


def _as_json(run: RunRecord) -> dict[str, Any]:
    plain = asdict(run)
    del plain["table"]
    return plain


def diff(a: str, b: str, store: Path | None, as_json: bool) -> int:
    """Show which stages have different keys in two runs, the reasons, and differences of outputs and costs."""
    from runner.run_diff import StageDiff, compare_runs

    runner = open_existing(store, plan_only=True)
    one, two = (_or_usage_error(lambda word=word: find_run(runner.store.root, word)) for word in (a, b))  # type: ignore[misc]
    tables = _or_usage_error(lambda: (one.keys(), two.keys()))
    found: list[StageDiff] = compare_runs(*tables, runner.traces, runner.store.root)
    if as_json:
        print_json({"a": _as_json(one), "b": _as_json(two),
                    "stages": [{**asdict(stage), "costs_differ": stage.costs_differ} for stage in found]})
        return 0
    for name, run in (("A", one), ("B", two)):
        counts = ", ".join(f"{run.count(result)} {result}" for result in RESULTS if run.count(result))
        sys.stdout.write(f"{name}  {run.id}  {when(run.began)}  {run.target}  {counts}\n")
    for line in _setting_lines(one, two):
        sys.stdout.write(line + "\n")
    for stage in found:
        sys.stdout.write("\n".join(_stage_lines(stage)) + "\n")
    if not found:
        tasks = sum(len(shards) for shards in tables[0].values())
        sys.stdout.write(f"no stage differs: both runs used the same {tasks} tasks\n")
    return 0


def _setting_lines(one: RunRecord, two: RunRecord) -> Iterator[str]:
    for name in sorted({*one.settings, *two.settings}):
        old, new = one.settings.get(name), two.settings.get(name)
        if old != new:
            yield f"--{name}: {_typed(old)} -> {_typed(new)}"


def _typed(value: Any) -> str:
    return "(none)" if value in (None, [], "") else " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _stage_lines(stage: Any) -> Iterator[str]:
    yield stage.stage
    for part, shards in stage.changed.items():
        yield f"  {part}  ({_shards(shards)})"
    for run, shards in (("A", stage.only_a), ("B", stage.only_b)):
        if shards:
            yield f"  only in {run}: {_shards(shards)}"
    if stage.outputs:
        yield f"  outputs differ: {_shards(stage.outputs)}"
    if stage.changed and not stage.outputs:
        yield "  outputs are the same"
    if stage.costs_differ:
        old, new = stage.cpu_s
        relative = f" ({(new - old) / old:+.0%})" if old else ""
        yield f"  CPU: {old:.1f} s -> {new:.1f} s{relative}"


def _shards(shards: list[str]) -> str:
    """Number and names of shards: '4 shards: a, b, c, ...'; nothing but '1 task' for a stage that runs once."""
    if shards == [""]:
        return "1 task"
    names = ", ".join(shards[:SHOWN]) + (", ..." if len(shards) > SHOWN else "")
    return f"{len(shards)} shard{'s' if len(shards) > 1 else ''}: {names}"


def timeline(run: str, out: Path, store: Path | None) -> int:
    """Draw the tasks of a run over time."""
    if out.suffix not in (".svg", ".png"):
        raise UsageError(f"--out {out}: the name must end in .svg or .png")
    folder = existing_store(store)
    found = _or_usage_error(lambda: find_run(folder, run))
    from commands.timeline import draw_timeline

    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        _or_usage_error(lambda: draw_timeline(found, out))
    except OSError as error:
        raise UsageError(f"--out {out}: the file cannot be written ({error.strerror or error})") from error
    sys.stdout.write(f"{out}\n")
    return 0


def stale(request: Any) -> int:
    """Show what would run now: a line for each stage, state and reason."""
    from commands.store import plan_request
    from commands.target_graphs import resolve_target
    from runner.plan_groups import group_plans

    plans = plan_request(request, open_existing if request.store else open_runner)
    groups = group_plans(plan for plan in plans if plan.status != "cached")
    if request.json:
        print_json({"target": resolve_target(request.target, request.only), "tasks": len(plans),
                    "stale": [asdict(group) for group in groups]})
        return 0
    if not groups:
        sys.stdout.write(f"nothing to do: all {len(plans)} tasks are cached\n")
        return 0
    table = plain_table("stage", "state", "tasks", "first shards", folded="reason")
    for group in groups:
        names = ", ".join(filter(None, group.shards)) + (", ..." if group.count > len(group.shards) else "")
        table.add_row(group.stage, group.status, str(group.count), escape(names), escape(group.reason))
    console().print(table)
    counts: Counter[str] = Counter(plan.status for plan in plans)
    sys.stdout.write(", ".join(f"{counts[status]} {status}" for status in sorted(counts)) + "\n")
    return 0


def _or_usage_error(read: Callable[[], T]) -> T:
    """Call `read`; what is wrong with a run is an error of the command line."""
    try:
        return read()
    except (UnknownRunError, LostTableError, BrokenLogError) as error:
        raise UsageError(str(error)) from error
