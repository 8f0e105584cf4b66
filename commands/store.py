"""Verbs about the store: plan, explain, status, graph, lineage, verify, gc, du."""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.tree import Tree

from afford.common.kernel_cache import collect_kernels
from commands.compare import build_columns
from commands.errors import UsageError, unknown
from commands.only import plan_only as plan_of_stages
from commands.origin import origin
from commands.run import Request
from commands.session import ROOT, STORE, digester, open_existing, open_runner
from commands.settings import columns
from commands.tables import console, plain_table, print_json
from commands.target_graphs import first_target_with, graph_of_request, resolve_stages, resolve_target
from commands.targets import TARGETS
from commands.weights import resolve_weights
from runner import Graph, Runner, TaskPlan
from runner.garbage import Rules, UnknownStageError
from runner.plan_groups import group_plans

BEGINNING = re.compile(r"[0-9a-f]+")
"""prefix of a digest"""
SHOWN_FILES = 6
KERNELS = "(kernels)"
"""row of compiled kernels of old sources"""
MANY_TASKS = 300
"""tasks up to which `explain` prints one line each"""


def plan_request(request: Request, opened: Callable[..., Runner] = open_runner) -> list[TaskPlan]:
    """Tasks that `run` would execute, without executing them."""
    runner, graph, target = _prepared(request, opened)
    force = resolve_stages(request.force, target, graph)
    if request.only:
        return plan_of_stages(runner, graph, resolve_stages([request.only], target, graph), request.clips, force)
    return runner.plan(graph, target, shards=request.clips or None, force=force)


def dry_run(request: Request) -> int:
    """Show the tasks that would run, with reasons."""
    plans = plan_request(request)
    if request.json:
        print_json({"target": resolve_target(request.target, request.only), "tasks": [_plan(plan) for plan in plans]})
    else:
        _show_groups([plan for plan in plans if plan.status != "cached"])
        counts = Counter(plan.status for plan in plans)
        console().print(", ".join(f"{counts[status]} {status}" for status in sorted(counts)) or "nothing to do")
    return 0


def explain(request: Request, clip: str | None, every: bool = False) -> int:
    """Show the reason of each task's next or last run, of one stage if `only` names it.

    More than MANY_TASKS tasks are grouped by stage, state and reason, unless `every` task is wanted.
    """
    runner, graph, target = _prepared(request, open_existing if request.store else open_runner)
    stages = resolve_stages([request.only], target, graph) if request.only else [node.name for node in graph.stages()]
    wanted = set(stages)
    plans = [plan for plan in runner.explain(graph, target, shard=clip) if plan.stage in wanted]
    if clip and not plans:
        known = {part for plan in runner.plan(graph, target) for part in plan.shard.split("/")}
        known -= {"", "*"}  # a task over the whole run, and shards that are not known yet
        raise unknown("clip", clip, known)
    if request.json:
        print_json({"target": target, "tasks": [_plan(plan) for plan in plans]})
    elif every or len(plans) <= MANY_TASKS:
        _show_plans(plans)
    else:
        _show_groups(plans)
        sys.stdout.write(f"{len(plans)} tasks, grouped; --all lists each, --clip those of one clip\n")
    return 0


def status(request: Request) -> int:
    """Show the shards of each stage that are cached, to run or pending, and unresolved failures.

    Failures of other sources, targets or settings are only counted. A stage can be named in place of a target.
    """
    if request.target and request.target.replace("_", "-") not in TARGETS:
        request = replace(request, target=None, only=_known(request.target))
    runner, graph, target = _prepared(request, open_existing if request.store else open_runner)
    shown = resolve_stages([request.only], target, graph) if request.only else [node.name for node in graph.stages()]
    plans = runner.plan(graph, target)
    keys, failures = {plan.key for plan in plans}, runner.failures()
    mine, others = [[failure for failure in failures if (failure["key"] in keys) is own] for own in (True, False)]
    counts: dict[str, Counter[str]] = {stage: Counter() for stage in shown}
    for plan in plans:
        if plan.stage in counts:
            counts[plan.stage][plan.status] += 1
    if request.json:
        print_json({"target": target, "stages": {k: dict(v) for k, v in counts.items()}, "failures": mine,
                     "failures_elsewhere": others})
        return 0
    table = plain_table("stage", "cached", "to run", "pending")
    for stage, count in counts.items():
        table.add_row(stage, *(str(count[status] or "") for status in ("cached", "run", "pending")))
    console().print(table)
    for failure in mine[:MANY_TASKS]:
        message = escape(f"{failure['stage']} {failure['shard']}: {failure['message']}")
        console().print(f"[red]failed[/] {message}", highlight=False, soft_wrap=True)
    if len(mine) > MANY_TASKS:
        console().print(f"and {len(mine) - MANY_TASKS} more failures; --json lists them", highlight=False)
    if others:
        console().print(f"{len(others)} task(s) of other sources, targets or settings failed in this store; --json lists them",
                      highlight=False, soft_wrap=True)
    return 0


def graph_text(graph: Graph) -> str:
    """One line per stage with its inputs."""
    lines = []
    for node in graph.stages():
        sources = ", ".join(f"{name} <- {graph.nodes[source].name}" for name, source in node.inputs)
        lines.append(f"{'  ' * len(node.axes)}{node.name:<24} {sources}")
    return "\n".join(lines)


def graph(request: Request, out: Path | None) -> int:
    """Print the stages and their inputs as text, or draw them to an SVG or PNG."""
    target = resolve_target(request.target)
    chosen = columns(request.sets, request.params)
    place, _ = origin(target, request.source, next(iter(chosen.values())), lambda path: "")  # file contents do not matter here
    drawn, _ = build_columns(target, place, chosen)
    if out is None:
        sys.stdout.write(graph_text(drawn) + "\n")
        return 0
    if out.suffix not in (".svg", ".png"):
        raise UsageError(f"--out {out}: the name must end in .svg or .png")
    from afford.extraction.stage_graph import draw_graph

    edges = {(maker, node.name) for node in drawn.stages() for _, source in node.inputs for maker in _stages_of(drawn, source)}
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        draw_graph([node.name for node in drawn.stages()], sorted(edges), out)
    except OSError as error:
        raise UsageError(f"--out {out}: the file cannot be written ({error.strerror or error})") from error
    sys.stdout.write(f"{out}\n")
    return 0


def _stages_of(graph: Graph, at: int) -> Iterator[str]:
    """Yield the stages behind a node's value; none for a leaf and for an empty list."""
    node = graph.nodes[at]
    if node.sort == "stage":
        yield node.name
        return
    for _, source in node.inputs:
        yield from _stages_of(graph, source)


def lineage(artifact: str, store: Path | None, as_json: bool) -> int:
    """Show the provenance of an artifact, down to the leafs.

    `artifact` is a digest, its prefix, a path in the store or linked from it, or a stage, which stands for its last output.
    """
    runner = open_existing(store)
    path = Path(artifact)
    try:
        found = runner.lineage(_digest_of(runner, path) if path.exists() else _last_of(runner, artifact) or artifact)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if as_json:
        print_json(asdict(found))
        return 0
    tree = Tree(_origin_line(found))
    _grow(tree, found, {found.digest})
    console().print(tree, crop=False, no_wrap=True, overflow="ignore")
    return 0


def _digest_of(runner: Runner, path: Path) -> str:
    """Keep a path in the store; find the blob of a published file by its content."""
    store = runner.store.root.resolve()
    if path.resolve().is_relative_to(store) and path.resolve().relative_to(store).parts[0] == "blobs":
        return str(path)
    file = path if path.is_file() else next(iter(sorted(p for p in path.rglob("*") if p.is_file())), path)
    blob = runner.hash_file(file)[0]
    return str(runner.store.path("blobs", blob))


def _last_of(runner: Runner, word: str) -> str:
    """Last output of a stage of this name, else of this function; '' for a word that is not a stage.

    UsageError for a stage that never ran in this store.
    """
    stage = word.replace("-", "_")
    if not stage.isidentifier() or BEGINNING.fullmatch(word):
        return ""
    traces = sorted(runner.traces.all(), key=lambda trace: trace.finished)
    made = [one.output for one in traces if one.stage == stage] or [
        one.output for one in traces if one.function.partition(":")[0].rpartition(".")[2] == stage]
    if not made:
        raise UsageError(f"stage {stage!r} of {first_target_with(stage)} never ran in this store; run it with `run --only {stage}`")
    return made[-1]


def _known(word: str) -> str:
    """Return a word that is not a target but a stage. UsageError when it is neither."""
    try:
        first_target_with(word)
    except UsageError as error:
        raise (unknown("target", word, TARGETS) if get_close_matches(word, TARGETS) else error) from None
    return word


def _origin_line(origin: Any) -> str:
    trace = origin.trace
    outside = "" if origin.inputs else "[dim]from outside[/]"
    made = f"[bold]{trace.stage}[/] {escape(trace.shard)}" if trace else outside
    return f"{origin.kind} {origin.digest[:12]}  {made}"


def _grow(tree: Tree, origin: Any, seen: set[str]) -> None:
    """Add the inputs of an artifact to the tree; an artifact that was shown before is only named."""
    for path in origin.files[:SHOWN_FILES]:
        tree.add(escape(path))
    if len(origin.files) > SHOWN_FILES:
        tree.add(f"and {len(origin.files) - SHOWN_FILES} more files")
    for name, source in origin.inputs:
        before = source.digest in seen
        branch = tree.add(f"{escape(name)}: {_origin_line(source)}" + (" [dim](see above)[/]" if before else ""))
        seen.add(source.digest)
        if not before:
            _grow(branch, source, seen)


def verify(store: Path | None, as_json: bool) -> int:
    """Hash every stored file again; return 1 when a file is damaged, missing or changed."""
    verdict = open_existing(store).verify()
    if as_json:
        print_json({**asdict(verdict), "ok": verdict.ok})
    else:
        for kind in ("damaged", "missing", "changed"):
            for name in getattr(verdict, kind):
                console().print(f"[red]{kind}[/] {escape(name)}", highlight=False, soft_wrap=True)
        state = "no problem found" if verdict.ok else "run again to repair"
        console().print(f"{verdict.blobs} blobs, {verdict.bytes / 1e6:.1f} MB: {state}")
    return 0 if verdict.ok else 1


def gc(store: Path | None, rules: Rules, dry_run: bool, as_json: bool) -> int:
    """Delete what the rules do not keep and compiled kernels of old sources, or count it.

    UsageError for a stage of `drop` that the store lacks.
    """
    try:
        swept = open_existing(store).gc(dry_run, rules)
    except UnknownStageError as error:
        raise UsageError(str(error)) from error
    files, size = collect_kernels(ROOT, store or STORE, dry_run=dry_run)
    if files:
        swept.stages[KERNELS] = {"files": files, "bytes": size}
        swept = replace(swept, files=swept.files + files, bytes=swept.bytes + size)
    if as_json:
        print_json(asdict(swept))
        return 0
    table = plain_table("stage", "files", "MB")
    for stage, row in sorted(swept.stages.items(), key=lambda item: -item[1]["bytes"]):
        table.add_row(stage, str(row["files"]), f"{row['bytes'] / 1e6:.1f}")
    if swept.stages:
        console().print(table)
    done = "would delete" if dry_run else "deleted"
    dropped = f"; {swept.dropped} artifact(s) can be computed again" if swept.dropped else ""
    sys.stdout.write(f"{done} {swept.files} files, {swept.bytes / 1e6:.1f} MB, and {swept.traces} result(s) from {store or STORE}"
                     f"{dropped}\n")  # fmt: skip
    return 0


def du(store: Path | None, as_json: bool) -> int:
    """Show the disk usage of the store by stage."""
    use = open_existing(store).disk_usage()
    if as_json:
        print_json({**asdict(use), "bytes": use.bytes})
        return 0
    table = plain_table("stage", "MB", "files", "results", "artifacts", "dropped", "shared MB")
    for stage, row in use.stages.items():
        shared = f"{row.shared_bytes / 1e6:.1f}" if row.shared_bytes else ""
        table.add_row(stage, f"{row.bytes / 1e6:.1f}", *(str(count or "") for count in (row.files, row.results, row.artifacts,
                                                                                        row.dropped)), shared)  # fmt: skip
    for room, size in use.rooms.items():
        table.add_row(f"{room}/", f"{size / 1e6:.1f}")
    console().print(table)
    sys.stdout.write(f"{use.bytes / 1e6:.1f} MB in {store or STORE}; files that several stages share are counted for the first\n")
    return 0


def _prepared(request: Request, opened: Callable[..., Runner] = open_runner) -> tuple[Runner, Graph, str]:
    target = resolve_target(request.target, request.only)
    chosen = columns(request.sets, request.params)
    runner = opened(request.store, plan_only=True, remote=request.remote)
    weighted = {name: resolve_weights(column, digester(runner), target) for name, column in chosen.items()}
    graph, *_ = graph_of_request(target, request.source, request.clips, request.sets, weighted, digester(runner))
    return runner, graph, target


def _plan(plan: TaskPlan) -> dict[str, str]:
    return {"stage": plan.stage, "clip": plan.shard, "status": plan.status, "reason": str(plan.reason), "key": plan.key}


def _show_plans(plans: list[TaskPlan]) -> None:
    table = plain_table("stage", "clip", "state", folded="reason")
    for plan in plans:
        table.add_row(plan.stage, escape(plan.shard), plan.status, escape(str(plan.reason)))
    console().print(table)


def _show_groups(plans: list[TaskPlan]) -> None:
    """Print one row for all tasks of a stage with the same state and reason; for a single task, its clip."""
    groups = group_plans(plans)
    table = plain_table("stage", "state", "tasks", folded="reason")
    for group in groups:
        name = escape(group.shards[0]) or "1" if group.count == 1 else str(group.count)
        table.add_row(group.stage, group.status, name, escape(group.reason))
    if groups:
        console().print(table)
