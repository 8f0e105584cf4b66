"""Measure the models in `weights/` out of their shipped files, and write the figures into their cards.

    PYTHONPATH=. python benchmarks/shipped/score.py [NAME ...] [--store DIR] [--cases DIR,...]

--cases: sets of stills for the two-hand model, such as those of `run benchmark-set` with each renderer; one is rendered by default.
The first of several sets also gives the example pictures of the demo, which no training shows.
Intervals hold 95 % of resampled cases (strict measures, docs/twohands/benchmark.md) or are Wilson's, of rates. One model each: how
much a training varies is measured by the benchmarks that train.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from afford.common.files import tree
from afford.common.statistics import wilson_interval
from afford.models.shipped import CARD, FOLDER, MEASURED, TWO_HANDS, shipped_files
from afford.twohands.demo.examples import EXAMPLES, examples
from benchmarks.shipped.recipes import RECIPES
from commands.progress import observer
from commands.session import digester, open_runner
from commands.settings import settings
from maps import bodies, grasping, rgbd, surface, twohands
from maps.household import TRACES
from maps.settings import Origin, Settings
from maps.synthetic import stills_to_measure
from runner import Graph, Runner
from schemas.files import FileTree
from schemas.grasp import LEVELS
from stages.grasping import grasp_report, household_report
from stages.rgbd import sor3d_evaluate, sor3d_report
from stages.twohands import baseline_cases, benchmark, score_cases

Figures = Mapping[str, float]
Row = tuple[str, ...]
GROUPS = (("", "crops"), ("known.", "crops, known kinds"), ("new.", "crops, kinds never shown"),
          ("shift.", "crops, workshop and desk"), ("masks.", "whole pictures"))  # fmt: skip
METHODS = (("small", "model"), ("small_text_shuffled", "model, another task's words"), ("centre", "Gaussian in the middle"))
MEASURES = (("iou", "IoU"), ("first_mode_iou", "first-mode IoU"), ("precision", "precision"), ("taxonomy_accuracy", "taxonomy"),
            ("ece", "ECE"))  # fmt: skip

HOUSEHOLD = ("household_plan.seed=20271", "household_plan.per_category=1", "household_tasks.uses=2", "body_evaluate.episodes=1")
"""bodies of docs/grasping/household.md, on which the recipe was not chosen"""
KNOWN = "other shapes of the categories of the training"


def run(runner: Runner, stage: str, build: Callable[[Graph], FileTree]) -> Figures:
    """Figures of the report (`metrics.json`) that a stage of the graph writes. SystemExit where a stage failed."""
    g = Graph()
    g.target("figures", build(g))
    with observer(quiet=False) as shown:
        report = runner.run(g, "figures", observer=shown)
    if not report.ok:
        raise SystemExit(str(report.failures[0]))
    ((_, digest),) = report.outputs[stage]
    found: Figures = json.loads(runner.load(digest).find("metrics.json").path.read_text())
    return found


def with_interval(found: Figures, name: str) -> str:
    """Figure with its interval where there is one; '' for none."""
    if name not in found:
        return ""
    ends = [found.get(f"{name}.{end}") for end in ("low", "high")]
    return f"{found[name]:.3f}" + (f" [{ends[0]:.3f}, {ends[1]:.3f}]" if None not in ends else "")


def two_hands(g: Graph, model: FileTree, cases: FileTree | None, **changed: Any) -> FileTree:
    """Score the model with right and with wrong words, and a Gaussian, on stills; `changed` are parameters of `predict_cases`."""
    p = Settings()
    p = p.with_stages(predict_cases=replace(p.twohands.predict_cases, **changed))
    shown = stills_to_measure(g, p) if cases is None else g.leaf("cases", cases)
    predicted = twohands.predict_with_prompts(g, shown, g.leaf("model", model), p)
    predicted = {name: files for name, files in predicted.items() if not name.endswith("removed")}
    predicted["centre"] = g.named("baseline_centre").add(
        baseline_cases.run, cases=shown, dataset=g.leaf("no_dataset", FileTree("none", ())), ctx=g.ctx,
        params=replace(p.twohands.baseline_cases, backend="centre"))  # fmt: skip
    scores = [g.named(f"score_{name}").add(score_cases.run, cases=shown, predictions=files, params=p.twohands.score_cases)
              for name, files in predicted.items()]  # fmt: skip
    return g.add(benchmark.run, scores=tuple(scores), others=g.leaf("others", ()), params=p.twohands.benchmark, ctx=g.ctx)


def two_hand_rows(found: Figures, name: str) -> Iterator[Row]:
    """Rows of the table of the two-hand model."""
    for prefix, group in GROUPS:
        for method, title in METHODS:
            if f"{prefix}{method}.iou" in found:
                yield (name, f"{group} ({found[f'{prefix}{method}.cases']:.0f})", title,
                       *(with_interval(found, f"{prefix}{method}.{measure}") for measure, _ in MEASURES))  # fmt: skip


def score_two_hands(runner: Runner, model: FileTree, args: argparse.Namespace) -> list[Row]:
    """Table of the two-hand model, by set of stills."""
    out: list[Row] = [("stills", "cases", "", *(title for _, title in MEASURES))]
    for folder in args.cases or [None]:
        files = tree("cases", folder) if folder else None
        found = run(runner, "benchmark", lambda g, files=files: two_hands(g, model, files))
        out += two_hand_rows(found, folder.name if folder else "rendered")
    return out


def score_parts(runner: Runner, model: FileTree, args: argparse.Namespace) -> list[Row]:
    """Table of the part scorer on procedural objects, by split and method."""
    found = run(runner, "negative_affordance_report", lambda g: surface.score_objects(
        g, Origin("negative-affordance"), g.leaf("scorer", model), Settings())[2])  # fmt: skip
    named = ("iou", "precision", "recall")
    rows = [(method, split, *(with_interval(found, f"{prefix}{split}.{name}") for name in named))
            for split in ("seen", "unseen") for method, prefix in (("scorer", ""), ("whole object", "whole_object."))]  # fmt: skip
    return [("method", "objects", *named), *rows]


def score_sor3d(runner: Runner, model: FileTree, args: argparse.Namespace) -> list[Row]:
    """Table of the SOR3D-AFF model on rendered validation sequences."""
    def build(g: Graph) -> FileTree:
        p, planned = Settings(), rgbd.default_recipes(Settings())
        data = rgbd.training_data(g, Origin("sor3d"), p).dataset
        named = replace(model, name=planned[0].name)
        scores = g.add(sor3d_evaluate.run, dataset=data, model=g.each(g.leaf("models", (named,))), ctx=g.ctx,
                       params=p.rgbd.sor3d_evaluate)  # fmt: skip
        return g.add(sor3d_report.run, recipes=g.leaf("planned", planned), scores=g.collect(scores), params=p.rgbd.sor3d_report,
                     ctx=g.ctx)  # fmt: skip

    found = run(runner, "sor3d_report", build)
    named = ("iou", "f", "fw")
    return [("input", "IoU", "F", "weighted F"),
            *((title, *(with_interval(found, f"{mode}.{name}") for name in named))
              for mode, title in (("video", "videos"), ("static", "pictures")))]  # fmt: skip


def score_policy(name: str) -> Callable[[Runner, FileTree, argparse.Namespace], list[Row]]:
    """Maker of the table of a policy: all levels, in the fast engine; tasks and start poses are drawn as in `run grasp`."""
    def score(runner: Runner, model: FileTree, args: argparse.Namespace) -> list[Row]:
        def build(g: Graph) -> FileTree:
            p = grasping.in_engine(Settings(), "mujoco")
            made = grasping.evaluate(g, grasping.setup(g, p), g.leaf("policy", model), name, 0, LEVELS, p)
            none: dict[str, Any] = {key: g.leaf(key, ()) for key in ("logs", "followed", "pairs", "sheets", "judged")}
            return g.add(grasp_report.run, episodes=tuple(episodes for _, episodes in made), params=p.grasping.grasp_report,
                         ctx=g.ctx, **none)  # fmt: skip

        found = run(runner, "grasp_report", build)
        rows: list[Row] = [("level", "Succ", "AS %, successes", "forbidden contact at end", "episodes")]
        for level in LEVELS:
            of = {key: found.get(f"mujoco.{name}.{key}.{level}", float("nan")) for key in
                  ("succ", "succ_low", "succ_high", "as_violation_pct", "negative_contact_end", "episodes")}  # fmt: skip
            rows.append((level, f"{of['succ']:.3f} [{of['succ_low']:.3f}, {of['succ_high']:.3f}]", f"{of['as_violation_pct']:.1f}",
                         f"{of['negative_contact_end']:.2f}", f"{of['episodes']:.0f}"))
        return rows

    return score


def score_bodies(runner: Runner, model: FileTree, args: argparse.Namespace) -> list[Row]:
    """Table of a policy on new household bodies, held-out categories apart, in both engines; as in docs/grasping/household.md."""
    def build(g: Graph) -> FileTree:
        p = settings(HOUSEHOLD, None)
        p = p.with_stages(body_evaluate=replace(p.grasping.body_evaluate, traces=TRACES))
        hand = grasping.robot_hand(g, p)
        made = bodies.household_bodies(g, hand, p)
        episodes = bodies.evaluate_bodies(g, hand, made, {bodies.BODIES: g.leaf("policy", model)}, p)
        return g.add(household_report.run, bodies=g.collect(made.made), episodes=tuple(episodes), ctx=g.ctx,
                     params=household_report.Params())  # fmt: skip

    found = run(runner, "household_report", build)
    rows: list[Row] = [("categories", "engine", "Succ", "AS %, successes", "episodes")]
    for group in ("others", "held out"):
        for engine in Settings().grasping.body_report.engines:
            prefix = f"{bodies.BODIES}.{engine}.all.{group}."
            of = {name: found.get(f"{prefix}{name}", float("nan")) for name in ("succ", "as_violation_pct", "episodes")}
            low, high = wilson_interval(round(of["succ"] * of["episodes"]), round(of["episodes"]))
            rows.append((KNOWN if group == "others" else group, engine, f"{of['succ']:.3f} [{low:.3f}, {high:.3f}]",
                         f"{of['as_violation_pct']:.1f}", f"{of['episodes']:.0f}"))
    return rows


SCORES: dict[str, Callable[[Runner, FileTree, argparse.Namespace], list[Row]]] = {
    "twohands": score_two_hands, "parts": score_parts, "sor3d": score_sor3d, "grasp-prior": score_policy("prior"),
    "grasp-teacher": score_policy("teacher"), "grasp-bodies": score_bodies, "grasp-student": score_policy("student")}


def into(card: Path, rows: list[Row]) -> None:
    """Replace the measured part of a card."""
    before, _, rest = card.read_text().partition(MEASURED[0])
    line = [f"| {' | '.join(row)} |" for row in rows]
    table = "\n".join([line[0], f"|{'---|' * len(rows[0])}", *line[1:]])
    card.write_text(f"{before}{MEASURED[0]}\n{table}\n{MEASURED[1]}{rest.partition(MEASURED[1])[2]}")


def write_examples(cases: Path, folder: Path) -> None:
    """Write pictures of a set of stills for the demo, named by their tasks."""
    folder.mkdir(exist_ok=True)
    for one in examples(cases.parent, cases.name):
        (folder / f"{one.task.replace(' ', '-')}.jpg").write_bytes(one.jpeg)


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=", ".join(SCORES))
    parser.add_argument("--store", type=Path)
    parser.add_argument("--cases", type=lambda text: [Path(one).absolute() for one in text.split(",")])
    parser.add_argument("--jobs", type=int)
    args = parser.parse_args()
    runner = open_runner(args.store, jobs=args.jobs)
    for name in args.names or [name for name in RECIPES if (FOLDER / name).is_dir()]:
        model = shipped_files(name, digester(runner))
        if model is None:
            raise SystemExit(f"weights/{name}: no shipped model there; run benchmarks/shipped/ship.py {name}")
        rows = SCORES[name](runner, model, args)
        if name == TWO_HANDS and args.cases:
            write_examples(args.cases[0], FOLDER / name / EXAMPLES)
        into(FOLDER / name / CARD, rows)
        print(name, *(" | ".join(row) for row in rows), sep="\n", flush=True)


if __name__ == "__main__":
    main()
