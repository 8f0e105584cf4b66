"""From a data set to trained two-hand models, and how right they are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from maps.common import record_run, record_training, reported, weights
from maps.extraction import mined
from maps.settings import Origin, Settings
from maps.synthetic import stills_to_measure, stills_to_train
from runner import Graph
from schemas.benchmark import MethodScores
from schemas.files import FileTree
from schemas.training import Recipe, Trained
from stages.twohands import ablation_report, baseline_cases, benchmark, model_train, predict_cases, score_cases

FULL: dict[str, Any] = {"variant": "small", "hypotheses": 3, "text": True, "decoders": 2, "target": "affordance",
                        "data": "stills"}  # fmt: skip
ROWS: dict[str, dict[str, Any]] = {
    "full": {},
    "no_text": {"text": False},
    "clip": {"variant": "clip"},
    "k1": {"hypotheses": 1},
    "lisa": {"hypotheses": 1, "decoders": 1, "target": "object"},
    "hotspot": {"hypotheses": 1, "decoders": 1, "text": False},
    "extracted": {"data": "extracted"},
}
"""full: the small model; no_text: it is not told the task; clip: 2HAff-CLIP; k1: one region per hand, the paper's model; lisa: one
decoder and whole objects; hotspot: one heat map, no text; extracted: labels that the extraction took from rendered videos"""


def recipes(rows: Iterable[str], seeds: int) -> tuple[Recipe, ...]:
    """Every row with seed 0, then every row with seed 1, ...: what is stopped early has something of each. ValueError for an
    unknown row.
    """
    unknown = sorted(set(rows) - ROWS.keys())
    if unknown or seeds < 1:
        raise ValueError(f"ablation: expected rows of {', '.join(ROWS)} and at least one seed, got {unknown or seeds}")
    return tuple(Recipe(name=f"{row}-{seed}", row=row, seed=seed, **FULL | ROWS[row]) for seed in range(seeds) for row in rows)


def lessons(g: Graph, origin: Origin, p: Settings) -> FileTree:
    """What a model learns from: the data set or the videos that the user gives, else rendered stills."""
    if origin.dataset:
        return g.leaf("dataset", origin.dataset)
    return mined(g, origin, p) if origin.videos else stills_to_train(g, p)


def learn(g: Graph, dataset: FileTree, p: Settings) -> Trained:
    """A data set -> a trained two-hand model, with its curves."""
    started: dict[str, Any] = weights(g, p, "model_train")
    return g.add(model_train.run,           dataset=dataset,                    params=p.twohands.model_train, ctx=g.ctx, **started)


def ask(g: Graph, cases: FileTree, model: FileTree, p: Settings) -> dict[str, FileTree]:
    """What a trained model says of the cases, told the task, the task of another case, or none."""
    mine = p.twohands.predict_cases
    texts = (mine, replace(mine, name=f"{mine.name}_text_shuffled", text="shuffled"),
             replace(mine, name=f"{mine.name}_text_removed", text="removed"))
    return {told.name: g.named(f"predict_{told.text}").add(predict_cases.run, cases=cases, model=model, params=told, ctx=g.ctx)
            for told in texts}  # fmt: skip


def rule(g: Graph, cases: FileTree, dataset: FileTree, extracted: FileTree | None, p: Settings) -> dict[str, FileTree]:
    """What the baselines say of the cases; `extracted` is a data set of the benchmark's own videos, where there is one."""
    none = g.leaf("no_dataset", FileTree("none", ()))
    seen = {"whole_object": none, "object_box": none, "centre": none, "class_mean": dataset}
    seen |= {"extraction": g.leaf("extracted", extracted)} if extracted else {}
    return {name: g.named(f"baseline_{name}").add(baseline_cases.run, cases=cases, dataset=data, ctx=g.ctx,
                                                  params=replace(p.twohands.baseline_cases, backend=name))
            for name, data in seen.items()}  # fmt: skip


def compare(g: Graph, cases: FileTree, dataset: FileTree, model: FileTree, origin: Origin, p: Settings) -> FileTree:
    """A trained model, the baselines and the predictions of others on the same cases -> the report."""
    extracted = next((tree for tree in origin.predictions if tree.find("manifest.json")), None)
    masks = g.leaf("predictions", tuple(tree for tree in origin.predictions if tree is not extracted))
    said = ask(g, cases, model, p) | rule(g, cases, dataset, extracted, p)
    scores = [g.named(f"score_{name}").add(score_cases.run, cases=cases, predictions=tree, params=p.twohands.score_cases)
              for name, tree in said.items()]  # fmt: skip
    swapped = g.named("score_swapped").add(score_cases.run, cases=cases, predictions=said[p.twohands.predict_cases.name],
                                           params=replace(p.twohands.score_cases, swap=True))  # fmt: skip
    others = g.named("score_others").add(score_cases.run, cases=cases, predictions=g.each(masks), params=p.twohands.score_cases)
    report = g.add(benchmark.run, scores=(*scores, swapped), others=g.collect(others),
                   params=replace(p.twohands.benchmark, predictions=()), ctx=g.ctx)  # fmt: skip
    g.cost("ms_per_image", [said[p.twohands.predict_cases.name]], (report, "cases"), scale=1000)
    return report


def train(g: Graph, origin: Origin, p: Settings) -> None:
    """a two-hand affordance model, from rendered stills or from --source: a data set, or videos"""
    trained = learn(g, lessons(g, origin, p), p)
    files   = g.publish(g.pick(trained, lambda t: t.files), "models/{source}", as_="model")
    g.target("train", files, record_training(g, "model_train", trained, p.twohands.model_train))


def measure(g: Graph, origin: Origin, p: Settings) -> None:
    """the trained model, baselines and predictions of others on held-out stills, or on the cases of --source"""
    dataset = stills_to_train(g, p)
    cases   = g.leaf("cases", origin.cases) if origin.cases else stills_to_measure(g, p)
    model   = g.pick(learn(g, dataset, p), lambda t: t.files)
    report  = compare(g, cases, dataset, model, origin, p)
    g.target("benchmark", reported(g, report), record_run(g, "benchmark", report))


def ablate(g: Graph, origin: Origin, p: Settings) -> None:
    """what each part of the model is worth: rows of trainings over several seeds, on held-out stills; with --minutes, what is
    finished by then
    """
    planned = recipes(p.twohands.ablation_report.rows, p.twohands.ablation_report.seeds)
    cases   = stills_to_measure(g, p)
    by_data = {name: tuple(recipe for recipe in planned if recipe.data == name) for name in ("stills", "extracted")}
    learned = {"stills": stills_to_train, "extracted": lambda g, p: mined(g, origin, p)}
    scores  = [retrain(g, cases, learned[name](g, p), mine, p) for name, mine in by_data.items() if mine]
    others  = {"others": scores[1]} if scores[1:] else {}
    report  = g.add(ablation_report.run, recipes=g.leaf("planned", planned), scores=scores[0], ctx=g.ctx,
                    params=p.twohands.ablation_report, **others)
    g.target("ablation", reported(g, report), record_run(g, "ablation_report", report))


def retrain(g: Graph, cases: FileTree, dataset: FileTree, planned: tuple[Recipe, ...], p: Settings) -> tuple[MethodScores, ...]:
    """Every recipe trained on one data set, asked about the cases and scored."""
    of      = "" if planned[0].data == "stills" else f"{planned[0].data}_"
    steps   = p.twohands.ablation_report.steps or p.twohands.model_train.steps
    recipe  = g.each(g.leaf(f"{of}recipes", planned))
    trained = g.named(f"{of}model_train").add(model_train.run, dataset=dataset, recipe=recipe, ctx=g.ctx,
                                              params=replace(p.twohands.model_train, steps=steps), **weights(g, p, "model_train"))
    said    = g.named(f"{of}predict_cases").add(predict_cases.run, cases=cases, model=g.pick(trained, lambda t: t.files),
                                                params=replace(p.twohands.predict_cases, name=""), ctx=g.ctx)
    scores  = g.named(f"{of}score_cases").add(score_cases.run, cases=cases, predictions=said, params=p.twohands.score_cases)
    return g.collect(scores, partial=True)
