"""1c: a blob rots after a run has judged it sound and before its consumer reads it. The run heals it and ends whole."""

from __future__ import annotations

import importlib
import json
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.reliability.rows import Plan, Row
from runner import Graph, Runner
from tests.helpers.flipped_stores import FlippedStore, NoEndError, apart, damage, last_line

FORMS = ("straight", "pick", "gather", "collect", "each", "pick and collect")
JOBS = (0, 2)
EXTENTS = ("one blob", "every blob that stages made")


def rows(plan: Plan) -> list[Row]:
    """Forms of the graph between maker and consumer, in one process and with workers."""
    return [_row(plan, extent, jobs) for extent in EXTENTS for jobs in JOBS]


def _row(plan: Plan, extent: str, jobs: int) -> Row:
    row = Row(f"{extent} rotten after the check, consumer must run, {len(FORMS)} graph forms, jobs {jobs}")
    for n in range(plan.times(4, 1)):
        for form in FORMS:
            project = FlippedStore(plan.place(f"{extent} {jobs} {form} {n}")).write()
            rng = random.Random(f"{plan.seed} {form} {n}")
            row.count([f"{form}: {what}" for what in _wrong(project, form, jobs, extent, ("flip", "remove")[n % 2], rng)])
    return row


def _wrong(project: FlippedStore, form: str, jobs: int, extent: str, how: str, rng: random.Random) -> list[str]:
    try:
        found = apart(_healed, project, form, jobs, extent, how, rng)
        wrong = [] if found["ok"] else [f"the run failed: {found['failures']}"]
        if found["outputs"] != found["expected"]:
            wrong.append(f"outputs {found['outputs']} with ok={found['ok']}, expected {found['expected']}")
        if not found["ran"].get("maker"):
            wrong.append("the damage was not met")
        return wrong + ([] if apart(project.verify) else ["verify after the run is not ok"])
    except (NoEndError, RuntimeError) as error:
        return [last_line(error)]


def _healed(project: FlippedStore, form: str, jobs: int, extent: str, how: str, rng: random.Random) -> dict[str, Any]:
    """Build, then force the consumer and damage its input before it starts."""
    runner = project.runner(jobs)
    graph = _graph(form)
    expected = runner.run(graph, "all").outputs
    made = runner.run(graph, "made").outputs
    blobs = sorted({path for outputs in made.values() for _, digest in outputs for path in paths(runner, digest)})
    hurt = Damaging("user", blobs if extent != "one blob" else [rng.choice(blobs)], how, rng)
    fresh = project.runner(jobs)
    report = fresh.run(graph, "all", force=["user"], observer=hurt)
    return {"ok": report.ok, "ran": dict(report.ran), "outputs": report.outputs, "expected": expected,
            "failures": json.dumps([failure.message for failure in report.failures])}


def _graph(form: str) -> Graph:
    """maker -> (form) -> user; target `made` is what the user reads, `all` what it makes."""
    join, pair, shout, split, values = (
        importlib.import_module(f"toy.{name}") for name in ("join", "pair", "shout", "split", "values"))
    g = Graph()
    one, words = g.leaf("one", values.Word("one", "ab")), g.leaf("words", (values.Word("a", "ab"), values.Word("b", "cd")))
    word = g.each(words) if "collect" in form else one
    maker, user = g.named("maker"), g.named("user")
    if form == "each":
        made = g.each(maker.add(split.run, word=one, params=split.Params()))
    elif "pick" in form:
        made = g.pick(maker.add(pair.run, word=word), lambda both: both.left)
    else:
        made = maker.add(shout.run, part=word, word=word, params=shout.Params())
    if "collect" in form:
        used = user.add(join.run, words=g.collect(made))
    elif form == "gather":
        other = g.named("other").add(shout.run, part=one, word=made, params=shout.Params())
        used = user.add(join.run, words=(made, other))
    else:
        used = user.add(shout.run, part=made, word=one, params=shout.Params())
    g.target("made", made)
    g.target("all", used)
    return g


def paths(runner: Runner, digest: str) -> list[Path]:
    """Blobs of an artifact and its parts."""
    parts = runner.children(digest)
    return list(runner.files(digest).values()) if parts is None else [path for _, part in parts for path in paths(runner, part)]


@dataclass
class Damaging:
    """An observer that damages files when a task of a stage is about to be queued."""

    stage: str
    paths: list[Path]
    how: str
    rng: random.Random

    def planned(self, stage: str, shard: str) -> None:
        """Damage the files, once: restored files stay sound."""
        if stage == self.stage:
            for path in self.paths:
                damage(path, self.how, self.rng)
            self.paths = []

    def started(self, *_: Any) -> None:
        """Ignore starts: those of a batch are known late."""

    def cached(self, *_: Any) -> None:
        """Ignore hits."""

    def progress(self, *_: Any) -> None:
        """Ignore progress."""

    def finished(self, *_: Any) -> None:
        """Ignore the end of a stage."""
