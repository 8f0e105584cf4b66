"""Picture of a run: one lane for each task at a time, bars coloured by stage, cores and memory in use below."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from runner.history import RESOURCES
from runner.log_file import read_log
from runner.past_runs import LoggedTask, RunRecord, UnknownRunError, logged_tasks

PALETTE = ("#6aaed6", "#fdae6b", "#74c476", "#b39ddb", "#e78ac3", "#d4c95e", "#5ec4cf", "#c49a84", "#9ecae1", "#fdd0a2", "#a1d99b",
           "#dadaeb", "#fbb4c9", "#e9e29c", "#aee3e8", "#e0c6b8", "#4292c6", "#f58634", "#3fa35b", "#8e72c4", "#cf4f9c", "#a89c1f",
           "#2aa0ad", "#96684f", "#c6dbef", "#bdbdbd", "#969696", "#d9f0d3", "#fee391", "#ccebc5")  # fmt: skip
"""thirty colours; those of the stages with the most wall time are the most different ones"""
HATCHES = ("", "////", "....", "xxxx")
"""patterns that tell the thirty-first stage from the first"""
FAILED, IDLE = "#d62728", "#f2f2f2"
MANY = 4000
"""bars above which an SVG holds them as a picture"""
LEGEND_ROWS, WIDTH_IN = 8, 13.0
LEFT, WIDTH = 0.05, 0.9
"""of the axes, as parts of the width of the picture"""
LETTER_IN, LEGEND_LETTER_IN, PATCH_IN = 0.062, 0.068, 0.5
"""widths of a letter in a bar, of one in the legend, and of the legend's patch"""


class Bar(NamedTuple):
    """A task in its lane."""

    task: LoggedTask
    lane: int


def lanes(tasks: Sequence[LoggedTask]) -> list[Bar]:
    """Assign each task to the first lane that is free at its start, as a worker would be."""
    free: list[float] = []
    bars = []
    for task in sorted(tasks, key=lambda task: (task.start, task.end)):
        lane = next((at for at, until in enumerate(free) if until <= task.start), len(free))
        free[lane:lane + 1] = [task.end]
        bars.append(Bar(task, lane))
    return bars


def idle_spans(tasks: Sequence[LoggedTask]) -> list[tuple[float, float]]:
    """Spans between the first start and the last end in which no task ran."""
    spans, until = [], None
    for task in sorted(tasks, key=lambda task: task.start):
        if until is not None and task.start > until:
            spans.append((until, task.start))
        until = task.end if until is None else max(until, task.end)
    return spans


def draw_timeline(run: RunRecord, path: Path) -> None:
    """Draw the run; the suffix of the path gives the format.

    UnknownRunError when no task of the run was executed; BrokenLogError.
    """
    from afford.common.figures import Figure

    tasks = logged_tasks(run.path)
    if not tasks:
        raise UnknownRunError(f"run {run.id} executed no task, so there is nothing to draw; list the runs with `runs`")
    bars, samples = lanes(tasks), list(read_log(run.path, (RESOURCES,)))
    stages = _by_wall(tasks)
    height = 1 + max(bar.lane for bar in bars)
    labels = _labels(stages, tasks)
    columns = _columns(labels)
    rows = -(-len(labels) // columns)
    lanes_in, use_in, legend_in = min(6.0, max(1.6, 0.45 * height)), 1.2 if samples else 0.0, 0.2 * rows + 0.15
    total = lanes_in + use_in + legend_in + 1.0
    figure = Figure(figsize=(WIDTH_IN, total))
    top = figure.add_axes((LEFT, (legend_in + use_in + 0.6) / total, WIDTH, lanes_in / total))
    _draw_bars(top, bars, stages, run.began)
    _frame(top, height, run, tasks)
    if height <= 12:
        _name_bars(top, bars, run.began, run.seconds)
    last = top
    if samples:
        last = figure.add_axes((LEFT, (legend_in + 0.5) / total, WIDTH, use_in / total), sharex=top)
        _draw_resources(last, samples, run.began)
        top.tick_params(labelbottom=False)
    last.set_xlabel(f"seconds since the start of the run{_marks(tasks)}")
    _legend(figure, labels, columns)
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else {"Software": None})


def _by_wall(tasks: Sequence[LoggedTask]) -> dict[str, float]:
    """Stage -> wall seconds, the largest first."""
    found: dict[str, float] = {}
    for task in tasks:
        found[task.stage] = found.get(task.stage, 0.0) + task.end - task.start
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _style(at: int) -> dict[str, Any]:
    return {"facecolor": PALETTE[at % len(PALETTE)], "hatch": HATCHES[at // len(PALETTE) % len(HATCHES)]}


def _draw_bars(axes: Any, bars: list[Bar], stages: dict[str, float], began: float) -> None:
    from matplotlib.collections import PolyCollection

    for at, stage in enumerate(stages):
        corners = [_corners(bar, began) for bar in bars if bar.task.stage == stage]
        axes.add_collection(PolyCollection(corners, edgecolor="white", linewidth=0.3, rasterized=len(bars) > MANY, **_style(at)))
    for result, hatch in (("failed", "xxxx"), ("running", "////")):
        corners = [_corners(bar, began) for bar in bars if bar.task.result == result]
        if corners:
            axes.add_collection(PolyCollection(corners, facecolor="none", edgecolor=FAILED, linewidth=1.2, hatch=hatch))


def _name_bars(axes: Any, bars: list[Bar], began: float, seconds: float) -> None:
    """Write the names of stage and shard into bars that are wide enough."""
    for bar in bars:
        names = [bar.task.stage, bar.task.shard.split("/")[-1]]
        if (bar.task.end - bar.task.start) / seconds * WIDTH * WIDTH_IN > LETTER_IN * max(map(len, names)):
            middle = (bar.task.start + bar.task.end) / 2 - began
            axes.text(middle, bar.lane + 0.5, "\n".join(names).strip(), ha="center", va="center", fontsize=7, clip_on=True)


def _corners(bar: Bar, began: float) -> list[tuple[float, float]]:
    start, end = bar.task.start - began, bar.task.end - began
    return [(x, bar.lane + y) for x, y in ((start, 0.1), (end, 0.1), (end, 0.9), (start, 0.9))]


def _frame(axes: Any, height: int, run: RunRecord, tasks: list[LoggedTask]) -> None:
    """Axes, title, grey lanes, and red lines where no task runs at all."""
    axes.set(xlim=(0, max(run.seconds, max(task.end for task in tasks) - run.began)), ylim=(height, 0))
    axes.set_yticks([lane + 0.5 for lane in range(height)], [str(lane + 1) if height <= 24 else "" for lane in range(height)])
    axes.set_ylabel("tasks at a time")
    axes.set_facecolor(IDLE)
    for start, end in idle_spans(tasks):
        axes.axvspan(start - run.began, end - run.began, color=FAILED, alpha=0.15, linewidth=0)
    busy = sum(task.end - task.start for task in tasks) / (height * max(run.seconds, 1e-9))
    date = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(run.began))
    axes.set_title(f"run {run.target}, {date} ({run.id}): {run.outcome}, {len(tasks)} tasks, {run.seconds:.1f} s wall, "
                   f"{run.cpu_s:.1f} s CPU of tasks + {run.own_cpu_s:.1f} s of the scheduler, lanes {busy:.0%} busy", fontsize=10)


def _draw_resources(axes: Any, samples: list[Any], began: float) -> None:
    """Cores in use between two samples, and memory."""
    times = [message.time_ns / 1e9 - began for message in samples]
    cpu = [message.data["cpu_s"] for message in samples]
    cores = [(b - a) / (u - t) if u > t else 0.0 for a, b, t, u in zip(cpu, cpu[1:], times, times[1:], strict=False)]
    axes.step(times, [*cores[:1], *cores] or [0.0], where="pre", color="#444444", linewidth=1.2)
    axes.set_ylabel("cores")
    axes.set_ylim(0, max([1.0, *cores]) * 1.15)
    memory = axes.twinx()
    memory.plot(times, [message.data["rss_mib"] / 1024 for message in samples], color="#1f77b4", linewidth=1.0, linestyle="--")
    memory.set_ylabel("GiB", color="#1f77b4")
    memory.set_ylim(bottom=0)


def _marks(tasks: list[LoggedTask]) -> str:
    """Meaning of the marks that the picture has."""
    marks = {"pink: no task ran": idle_spans(tasks), "red crosses: failed": [task for task in tasks if task.result == "failed"],
             "red lines: without end": [task for task in tasks if task.result == "running"]}  # fmt: skip
    shown = ", ".join(name for name, found in marks.items() if found)
    return f"  ({shown})" if shown else ""


def _labels(stages: dict[str, float], tasks: list[LoggedTask]) -> list[str]:
    """'stage  6 x 1.23 s' for each stage: number of tasks and mean wall time."""
    counts: dict[str, int] = {}
    for task in tasks:
        counts[task.stage] = counts.get(task.stage, 0) + 1
    return [f"{stage}  {counts[stage]} \u00d7 {wall / counts[stage]:.2f} s" for stage, wall in stages.items()]


def _columns(labels: list[str]) -> int:
    """Columns of the legend: as few as LEGEND_ROWS rows need, and as fit side by side."""
    fit = int(WIDTH_IN / (LEGEND_LETTER_IN * max(map(len, labels)) + PATCH_IN))
    return max(1, min(fit, -(-len(labels) // LEGEND_ROWS)))


def _legend(figure: Any, labels: list[str], columns: int) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(edgecolor="white", label=label, **_style(at)) for at, label in enumerate(labels)]
    figure.legend(handles=handles, loc="lower center", ncols=columns, fontsize=8.5, frameon=False, bbox_to_anchor=(0.5, 0.0))
