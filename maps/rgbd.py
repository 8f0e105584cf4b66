"""Map of SOR3D-AFF: RGB-D interactions, scene flow, training, evaluation and ablation, one line per stage."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from afford.rgbd.evaluate.ablation_rows import PRETRAINED, recipes, row_label
from afford.rgbd.model.config import BoxesParams
from maps.common import record_run, record_training, reported, weights
from maps.settings import Origin, Settings
from runner import Graph
from schemas.files import FileTree
from schemas.interaction import InteractionClip, InteractionScores, InteractionTruth, SceneFlow, StaticSet
from schemas.training import Recipe, Trained
from stages.recording import interaction_record
from stages.rgbd import (
    action_pack,
    action_read,
    boxes_train,
    interaction_pack,
    interaction_read,
    scene_flow,
    scene_flow_score,
    sor3d_evaluate,
    sor3d_pretrain,
    sor3d_report,
    sor3d_train,
    static_evaluate,
    static_read,
    static_report,
)
from stages.synthetic import interaction_plan, interaction_render

REPORTS = {"static_sor3d": ("sor3d", False), "static_boxes": ("boxes", False), "static_true_boxes": ("boxes", True)}
"""stages that report, in the order of PictureReports: model, and true for true boxes"""
HELD = "val"
"""split of rendered sequences that no training uses"""


class Interactions(NamedTuple):
    """Handles of sequences and of their ground truth (None for recorded ones)."""

    clip: InteractionClip
    truth: InteractionTruth | None


def sequences(g: Graph, origin: Origin, p: Settings) -> Interactions:
    """Add every sequence of the source; rendered and recorded ones go through the same files and the same reader."""
    if origin.sequences:
        given = g.each(g.leaf("sequences", origin.sequences))
        return Interactions(g.add(interaction_read.run, files=given,                 params=p.rgbd.interaction_read), None)
    spec    = g.each(g.add(interaction_plan.run,                                     params=p.synthetic.interaction_plan))
    made    = g.add(interaction_render.run, spec=spec,                             params=p.synthetic.interaction_render, ctx=g.ctx)
    clip    = g.add(interaction_read.run,   files=g.pick(made, lambda m: m.files),   params=p.rgbd.interaction_read)
    return Interactions(clip, g.pick(made, lambda m: m.truth))


class TrainingData(NamedTuple):
    """Handles of sequences, their motion, and the data set of a training."""

    found: Interactions
    flow: SceneFlow
    """of each sequence"""
    dataset: FileTree


def training_data(g: Graph, origin: Origin, p: Settings) -> TrainingData:
    """Sequences, their motion and a data set; recorded ones get ten slots as in the released code, all of one length."""
    if origin.sequences:
        p = p.with_stages(interaction_read=replace(p.rgbd.interaction_read, frames="slots"),
                          interaction_pack=replace(p.rgbd.interaction_pack, name=origin.name, licence="unknown"))
    found   = sequences(g, origin, p)
    flow    = g.add(scene_flow.run, clip=found.clip,                                                 params=p.rgbd.scene_flow)
    packed  = g.add(interaction_pack.run,   clips=g.collect(found.clip), flows=g.collect(flow),      params=p.rgbd.interaction_pack,
                    ctx=g.ctx)
    return TrainingData(found, flow, packed)


def score_flows(g: Graph, x: TrainingData, p: Settings) -> dict[str, Any]:
    """Errors of the scene flow, FlowScores by input of the report; empty without ground truth."""
    if x.found.truth is None:
        return {}
    plain   = g.named("difference_flow").add(scene_flow.run, clip=x.found.clip,
                                             params=replace(p.rgbd.scene_flow, backend="difference"))
    score   = g.add(scene_flow_score.run,   flow=x.flow, plain=plain, truth=x.found.truth,         params=scene_flow_score.Params())
    return {"flows": g.collect(score)}


def pretrain_encoder(g: Graph, origin: Origin, dataset: FileTree, p: Settings) -> Trained:
    """Encoder of appearance, pre-trained on actions: those of UTKinect if given, else those of the sequences."""
    if origin.actions:
        clips   = g.add(action_read.run,    files=g.leaf("actions", origin.actions),                 params=p.rgbd.action_read)
        dataset = g.add(action_pack.run,    clips=clips,                             params=p.rgbd.action_pack, ctx=g.ctx)
    return g.add(sor3d_pretrain.run,        dataset=dataset,                         params=p.rgbd.sor3d_pretrain, ctx=g.ctx)


def default_recipes(p: Settings) -> tuple[Recipe, ...]:
    """Recipe of the one model that is trained without an ablation."""
    row     = PRETRAINED if p.rgbd.sor3d_report.pretrained else p.rgbd.sor3d_train.row
    return recipes((row,), (p.rgbd.sor3d_train.seed,), p.rgbd.sor3d_train.variant)


def stage_prefix(planned: tuple[Recipe, ...]) -> str:
    """Prefix of the stage names of recipes of one kind."""
    return "pretrained_" if row_label(planned[0]) == PRETRAINED else ""


class Trainings(NamedTuple):
    """Handles of a training and of its pre-training, if any."""

    model: Trained
    encoder: Trained | None


def train_model(g: Graph, origin: Origin, dataset: FileTree, planned: tuple[Recipe, ...], p: Settings) -> Trainings:
    """Train recipes of one kind, each in a shard of its own."""
    of      = stage_prefix(planned)
    encoder = pretrain_encoder(g, origin, dataset, p) if of else None
    more    = {"encoder": g.pick(encoder, lambda t: t.files)} if encoder else {}
    recipe  = g.each(g.leaf(f"{of}recipes", planned))
    model   = g.named(f"{of}sor3d_train").add(sor3d_train.run, dataset=dataset, recipe=recipe,       params=p.rgbd.sor3d_train,
                                              ctx=g.ctx, **more, **weights(g, p, "sor3d_train"))
    return Trainings(model, encoder)


def evaluate_model(g: Graph, dataset: FileTree, trained: Trained, planned: tuple[Recipe, ...], p: Settings,
            partial: bool = False) -> tuple[InteractionScores, ...]:  # fmt: skip
    """Scores of each model; `partial`: of those that are finished when a run with a limit ends."""
    scores  = g.named(f"{stage_prefix(planned)}sor3d_evaluate").add(
                sor3d_evaluate.run, dataset=dataset, model=g.pick(trained, lambda t: t.files), ctx=g.ctx,
                params=p.rgbd.sor3d_evaluate)
    return g.collect(scores, partial)


def sor3d(g: Graph, origin: Origin, p: Settings) -> None:
    """Affordances from RGB-D video of people who use objects: scene flow, training, evaluation; or from --source."""
    x, planned = training_data(g, origin, p), default_recipes(p)
    trained, encoder = train_model(g, origin, x.dataset, planned, p)
    scores  = evaluate_model(g, x.dataset, trained, planned, p)
    page    = g.add(sor3d_report.run, recipes=g.leaf("planned", planned), scores=scores,             params=p.rgbd.sor3d_report,
                    ctx=g.ctx, **score_flows(g, x, p))
    files   = g.publish(g.pick(trained, lambda t: t.files), "models/{source}", as_="model")
    shown   = [record_training(g, "sor3d_train", trained, p.rgbd.sor3d_train),
               *([record_training(g, "sor3d_pretrain", encoder, p.rgbd.sor3d_pretrain)] if encoder else [])]
    films   = g.add(interaction_record.run, dataset=x.dataset, model=files,        params=p.rgbd.interaction_record, ctx=g.ctx)
    g.publish(films, "recordings/{source}/interactions", as_="films")
    g.target("sor3d", reported(g, page), files, *shown, films, record_run(g, "sor3d_report", page))


def sor3d_ablation(g: Graph, origin: Origin, p: Settings) -> None:
    """Contribution of each part of SOR3D-AFF's model: rows over several seeds; with --minutes, the rows finished by then."""
    mine    = replace(p.rgbd.sor3d_report, ablation=True)
    x       = training_data(g, origin, p)
    seeds   = range(mine.first_seed, mine.first_seed + mine.seeds)
    planned = recipes(mine.rows, seeds, p.rgbd.sor3d_train.variant)
    q       = p.with_stages(sor3d_train=replace(p.rgbd.sor3d_train, steps=mine.steps or p.rgbd.sor3d_train.steps))
    kinds   = [tuple(one for one in planned if (row_label(one) == PRETRAINED) is late) for late in (False, True)]
    scores  = [evaluate_model(g, x.dataset, train_model(g, origin, x.dataset, some, q).model, some, q, partial=True)
               for some in kinds if some]  # fmt: skip
    more: dict[str, Any] = {"more": scores[1]} if scores[1:] else {}
    page    = g.add(sor3d_report.run, recipes=g.leaf("planned", planned), scores=scores[0], params=mine, ctx=g.ctx, **more,
                    **score_flows(g, x, p))
    g.target("sor3d-ablation", reported(g, page), record_run(g, "sor3d_report", page))


def interactions(g: Graph, origin: Origin, p: Settings) -> None:
    """RGB-D sequences of people who use objects, with the affordance of the last frame."""
    found = sequences(g, origin, p)
    g.target("interactions", found.clip, *([] if found.truth is None else [found.truth]))


class PictureReports(NamedTuple):
    """Handles of the reports on one set of pictures."""

    ours: FileTree
    own_boxes: FileTree
    """of the detector with its own box proposals"""
    true_boxes: FileTree
    """of the detector with true boxes"""


def pictures(g: Graph, files: FileTree, p: Settings) -> StaticSet:
    """Pictures of UMD or IIT-AFF, as `static_read.backend` says; only those of the evaluated split."""
    wanted  = replace(p.rgbd.static_read, split=p.rgbd.static_read.split or p.rgbd.static_evaluate.split)
    return g.add(static_read.run, files=g.leaf("pictures", files),                                   params=wanted)


def detector(g: Graph, dataset: FileTree, p: Settings) -> Trained:
    """Detector, trained on the last frames of the same data set as the model of sequences."""
    return g.add(boxes_train.run,           dataset=dataset,                                   params=p.rgbd.boxes_train, ctx=g.ctx)


def evaluate_pictures(g: Graph, samples: StaticSet | tuple[InteractionClip, ...], model: FileTree, boxes: FileTree,
         p: Settings) -> PictureReports:  # fmt: skip
    """Evaluate both models on the same pictures: `pictures`, or the last frames of one split of collected clips."""
    models  = {"sor3d": model, "boxes": boxes}
    return PictureReports(*(g.named(name).add(
        static_evaluate.run, samples=samples, model=models[backend],
        params=replace(p.rgbd.static_evaluate, name=name, backend=backend, boxes=BoxesParams(true)), ctx=g.ctx)
        for name, (backend, true) in REPORTS.items()))  # fmt: skip


def static_sets(g: Graph, origin: Origin, p: Settings) -> None:
    """Affordances of single pictures, by the model of `sor3d` and by a detector: rendered interactions, UMD or IIT-AFF."""
    x       = training_data(g, origin, p)
    model   = g.pick(train_model(g, origin, x.dataset, default_recipes(p), p).model, lambda t: t.files)
    trained = detector(g, x.dataset, p)
    boxes   = g.pick(trained, lambda t: t.files)
    held    = p.with_stages(static_evaluate=replace(p.rgbd.static_evaluate, split=p.rgbd.static_evaluate.split or HELD))
    found   = (evaluate_pictures(g, pictures(g, origin.pictures, p), model, boxes, p) if origin.pictures else
               evaluate_pictures(g, g.collect(x.found.clip), model, boxes, held))  # fmt: skip
    table   = g.add(static_report.run,      reports=tuple(found),   params=static_report.Params(origin.name), ctx=g.ctx)
    for name, report in zip((*REPORTS, "static_report"), (*found, table), strict=True):
        g.publish(report, f"reports/{{source}}/{name}", as_=name)
    for name, report in zip(REPORTS, found, strict=True):
        g.measure(report, under=f"{name}.")
    shown   = [record_run(g, name, files) for name, files in zip((*REPORTS, "static_report"), (*found, table), strict=True)]
    g.target("static-sets", *found, table, *shown, record_training(g, "boxes_train", trained, p.rgbd.boxes_train))
