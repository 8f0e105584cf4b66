"""Graphs of the two-hand models: training, benchmark and ablation."""

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
                        "data": "stills", "taxonomy": True, "steps": 0}  # fmt: skip
TINY_STEPS = 200
"""most steps of rows with a tiny random language model, which learns little from more"""
ROWS: dict[str, dict[str, Any]] = {
    "full": {},
    "no_text": {"text": False},
    "clip": {"variant": "clip"},
    "k1": {"hypotheses": 1},
    "hotspot": {"hypotheses": 1, "decoders": 1, "text": False},
    "vlm": {"variant": "vlm", "hypotheses": 1},
    "lisa": {"variant": "vlm", "hypotheses": 1, "decoders": 1, "target": "object", "taxonomy": False},
    "extracted": {"data": "extracted"},
}
"""full: the small model; no_text: without the task; clip: 2HAff-CLIP; k1: one region per hand; hotspot: one heat map, no text;
vlm: the paper's model; lisa: the same with one mask of the whole object, as LISA; extracted: labels that the extraction took from
rendered videos"""


def recipes(rows: Iterable[str], seeds: int, pretrained: bool = False, sizes: str = "") -> tuple[Recipe, ...]:
    """Plan the trainings of the ablation: all rows with seed 0, then all rows with seed 1, and so on.

    So an ablation that is stopped early has results of each row. Without `pretrained` backbones, rows of the variant vlm are short.
    ValueError for an unknown row.
    """
    unknown = sorted(set(rows) - ROWS.keys())
    if unknown or seeds < 1:
        raise ValueError(f"ablation: expected rows of {', '.join(ROWS)} and at least one seed, got {unknown or seeds}")
    short = {} if pretrained else {row: {"steps": TINY_STEPS} for row in rows if ROWS[row].get("variant") == "vlm"}
    return tuple(Recipe(name=f"{row}-{seed}", row=row, seed=seed, pretrained=pretrained, sizes=sizes,
                        **FULL | ROWS[row] | short.get(row, {})) for seed in range(seeds) for row in rows)  # fmt: skip


def training_data(g: Graph, origin: Origin, p: Settings) -> FileTree:
    """Training data: the data set or the videos of `--source`, else rendered stills."""
    if origin.dataset:
        return g.leaf("dataset", origin.dataset)
    return mined(g, origin, p) if origin.videos else stills_to_train(g, p)


def train_model(g: Graph, dataset: FileTree, p: Settings) -> Trained:
    """Train a two-hand model on a data set."""
    started: dict[str, Any] = weights(g, p, "model_train")
    started |= {"start": g.leaf("start", files)} if (files := dict(p.weights).get("start")) else {}
    return g.add(model_train.run,           dataset=dataset,                    params=p.twohands.model_train, ctx=g.ctx, **started)


def predict_with_prompts(g: Graph, cases: FileTree, model: FileTree, p: Settings) -> dict[str, FileTree]:
    """Predict the cases, prompted with their task, the task of another case, or none; predictions by name."""
    mine = p.twohands.predict_cases
    texts = (mine, replace(mine, name=f"{mine.name}_text_shuffled", text="shuffled"),
             replace(mine, name=f"{mine.name}_text_removed", text="removed"))
    return {one.name: g.named(f"predict_{one.text}").add(predict_cases.run, cases=cases, model=model, params=one, ctx=g.ctx)
            for one in texts}  # fmt: skip


def predict_baselines(g: Graph, cases: FileTree, dataset: FileTree, extracted: FileTree | None, p: Settings) -> dict[str, FileTree]:
    """Predict the cases with the baselines; `extracted` is a data set of the benchmark's own videos, if there is one."""
    none = g.leaf("no_dataset", FileTree("none", ()))
    data = {"whole_object": none, "object_box": none, "centre": none, "class_mean": dataset}
    data |= {"extraction": g.leaf("extracted", extracted)} if extracted else {}
    return {name: g.named(f"baseline_{name}").add(baseline_cases.run, cases=cases, dataset=given, ctx=g.ctx,
                                                  params=replace(p.twohands.baseline_cases, backend=name))
            for name, given in data.items()}  # fmt: skip


def benchmark_report(g: Graph, cases: FileTree, dataset: FileTree, model: FileTree, origin: Origin, p: Settings) -> FileTree:
    """Score a trained model, the baselines and the predictions of other methods on the same cases, and report them."""
    extracted = next((tree for tree in origin.predictions if tree.find("manifest.json")), None)
    masks = g.leaf("predictions", tuple(tree for tree in origin.predictions if tree is not extracted))
    predicted = predict_with_prompts(g, cases, model, p) | predict_baselines(g, cases, dataset, extracted, p)
    scores = [g.named(f"score_{name}").add(score_cases.run, cases=cases, predictions=tree, params=p.twohands.score_cases)
              for name, tree in predicted.items()]  # fmt: skip
    swapped = g.named("score_swapped").add(score_cases.run, cases=cases, predictions=predicted[p.twohands.predict_cases.name],
                                           params=replace(p.twohands.score_cases, swap=True))  # fmt: skip
    others = g.named("score_others").add(score_cases.run, cases=cases, predictions=g.each(masks), params=p.twohands.score_cases)
    report = g.add(benchmark.run, scores=(*scores, swapped), others=g.collect(others),
                   params=replace(p.twohands.benchmark, predictions=()), ctx=g.ctx)  # fmt: skip
    g.cost("ms_per_image", [predicted[p.twohands.predict_cases.name]], (report, "cases"), scale=1000)
    return report


def train(g: Graph, origin: Origin, p: Settings) -> None:
    """Train a two-hand affordance model on rendered stills, or on a data set or videos of --source."""
    trained = train_model(g, training_data(g, origin, p), p)
    files   = g.publish(g.pick(trained, lambda t: t.files), "models/{source}", as_="model")
    g.target("train", files, record_training(g, "model_train", trained, p.twohands.model_train))


def measure(g: Graph, origin: Origin, p: Settings) -> None:
    """Score the trained model, baselines and other methods on held-out stills, or on the cases of --source."""
    dataset = stills_to_train(g, p)
    cases   = g.leaf("cases", origin.cases) if origin.cases else stills_to_measure(g, p)
    model   = g.pick(train_model(g, dataset, p), lambda t: t.files)
    report  = benchmark_report(g, cases, dataset, model, origin, p)
    g.target("benchmark", reported(g, report), record_run(g, "benchmark", report))


def ablate(g: Graph, origin: Origin, p: Settings) -> None:
    """Ablate parts of the model: several trainings of each row, scored on held-out stills; with --minutes, those that finish."""
    chosen  = p.twohands.model_train
    usual   = model_train.RELEASE if chosen.recipe == "release" else model_train.QUICK
    of_lite = chosen.variant == "lite" and all(getattr(chosen, name) == getattr(usual, name) for name in model_train.SIZES)
    sizes   = "small" if of_lite else ""  # no row has the encoder of lite, nor its sizes unless they were asked for
    planned = recipes(p.twohands.ablation_report.rows, p.twohands.ablation_report.seeds, bool(chosen.backbones), sizes)
    cases   = stills_to_measure(g, p)
    by_data = {name: tuple(recipe for recipe in planned if recipe.data == name) for name in ("stills", "extracted")}
    data_of = {"stills": stills_to_train, "extracted": lambda g, p: mined(g, origin, p)}
    scores  = [train_and_score(g, cases, data_of[name](g, p), mine, p) for name, mine in by_data.items() if mine]
    others  = {"others": scores[1]} if scores[1:] else {}
    report  = g.add(ablation_report.run, recipes=g.leaf("planned", planned), scores=scores[0], ctx=g.ctx,
                    params=p.twohands.ablation_report, **others)
    g.target("ablation", reported(g, report), record_run(g, "ablation_report", report))


def train_and_score(g: Graph, cases: FileTree, dataset: FileTree, planned: tuple[Recipe, ...],
                    p: Settings) -> tuple[MethodScores, ...]:  # fmt: skip
    """Train all recipes on one data set, from no trained model, predict the cases and score the predictions."""
    of      = "" if planned[0].data == "stills" else f"{planned[0].data}_"
    chosen  = p.twohands.model_train
    steps   = p.twohands.ablation_report.steps or chosen.steps
    recipe  = g.each(g.leaf(f"{of}recipes", planned))
    started = weights(g, p, "model_train") if chosen.backbones else {}
    trained = g.named(f"{of}model_train").add(model_train.run, dataset=dataset, recipe=recipe, ctx=g.ctx,
                                              params=replace(chosen, steps=steps, start=""), **started)
    predicted    = g.named(f"{of}predict_cases").add(predict_cases.run, cases=cases, model=g.pick(trained, lambda t: t.files),
                                                params=replace(p.twohands.predict_cases, name=""), ctx=g.ctx)
    scores  = g.named(f"{of}score_cases").add(score_cases.run, cases=cases, predictions=predicted, params=p.twohands.score_cases)
    return g.collect(scores, partial=True)
