"""From RGB-D interactions to SOR3D-AFF's model, what it gets right and what each part of it is worth, one line per stage."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from afford.rgbd.evaluate.recipes import PRETRAINED, label, recipes
from maps.interactions import Interactions, sequences
from maps.recording import record_run
from maps.settings import Origin, Settings
from maps.weights import weights
from runner import Graph
from schemas.files import FileTree
from schemas.interaction import InteractionScores, SceneFlow
from schemas.training import Recipe, Trained
from stages.recording import interaction_record, training_record
from stages.rgbd import action_pack, action_read, interaction_pack, scene_flow, scene_flow_score, sor3d_evaluate, sor3d_report
from stages.twohands import model_train


class Lessons(NamedTuple):
    """What is learned from."""

    found: Interactions
    flow: SceneFlow
    """of each sequence"""
    dataset: FileTree


def lessons(g: Graph, origin: Origin, p: Settings) -> Lessons:
    """Sequences -> their motion -> a data set. Recorded ones get ten slots, as in the released code: lengths are one."""
    if origin.sequences:
        p = replace(p, interaction_read=replace(p.interaction_read, frames="slots"),
                    interaction_pack=replace(p.interaction_pack, name=origin.name, licence="unknown"))
    found   = sequences(g, origin, p)
    flow    = g.add(scene_flow.run, clip=found.clip,                                                 params=p.scene_flow)
    packed  = g.add(interaction_pack.run,   clips=g.collect(found.clip), flows=g.collect(flow),      params=p.interaction_pack,
                    ctx=g.ctx)
    return Lessons(found, flow, packed)


def moved(g: Graph, x: Lessons, p: Settings) -> dict[str, Any]:
    """How right the motion is, FlowScores by the name under which the report wants them; empty where nobody knows."""
    if x.found.truth is None:
        return {}
    plain   = g.named("difference_flow").add(scene_flow.run, clip=x.found.clip, params=replace(p.scene_flow, backend="difference"))
    score   = g.add(scene_flow_score.run,   flow=x.flow, plain=plain, truth=x.found.truth,         params=scene_flow_score.Params())
    return {"flows": g.collect(score)}


def before(g: Graph, origin: Origin, dataset: FileTree, p: Settings) -> FileTree:
    """The encoder of appearance, trained on actions: those of UTKinect where it is given, else those of the sequences."""
    if origin.actions:
        clips   = g.add(action_read.run,    files=g.leaf("actions", origin.actions),                 params=p.action_read)
        dataset = g.add(action_pack.run,    clips=clips,                             params=p.action_pack, ctx=g.ctx)
    trained = g.named("encoder_train").add(model_train.run, dataset=dataset,         params=p.sor3d_pretrain, ctx=g.ctx)
    return g.pick(trained, lambda t: t.files)


def usual(p: Settings) -> tuple[Recipe, ...]:
    """The one model that is trained where no row is asked for."""
    row     = PRETRAINED if p.sor3d_report.pretrained else p.sor3d_train.row
    return recipes((row,), (p.sor3d_train.seed,), p.sor3d_train.variant)


def kind(planned: tuple[Recipe, ...]) -> str:
    """What stands before the names of stages of recipes of one kind."""
    return "pretrained_" if label(planned[0]) == PRETRAINED else ""


def teach(g: Graph, origin: Origin, dataset: FileTree, planned: tuple[Recipe, ...], p: Settings) -> Trained:
    """Recipes of one kind, trained, each in a shard of its own."""
    of      = kind(planned)
    more: dict[str, Any] = {"encoder": before(g, origin, dataset, p)} if of else {}
    recipe  = g.each(g.leaf(f"{of}recipes", planned))
    return g.named(f"{of}model_train").add(model_train.run, dataset=dataset, recipe=recipe,          params=p.sor3d_train,
                                           ctx=g.ctx, **more, **weights(g, p, "sor3d_train"))


def examine(g: Graph, dataset: FileTree, trained: Trained, planned: tuple[Recipe, ...], p: Settings,
            partial: bool = False) -> tuple[InteractionScores, ...]:  # fmt: skip
    """What each of them gets right; `partial`: of those that are finished when a run with a limit ends."""
    scores  = g.named(f"{kind(planned)}sor3d_evaluate").add(
                sor3d_evaluate.run, dataset=dataset, model=g.pick(trained, lambda t: t.files), params=p.sor3d_evaluate, ctx=g.ctx)
    return g.collect(scores, partial)


def sor3d(g: Graph, origin: Origin, p: Settings) -> None:
    """where things afford what, from RGB-D video of people who use them: flow, training, examination; or from --source"""
    x, planned = lessons(g, origin, p), usual(p)
    trained = teach(g, origin, x.dataset, planned, p)
    scores  = examine(g, x.dataset, trained, planned, p)
    page    = g.add(sor3d_report.run, recipes=g.leaf("planned", planned), scores=scores,             params=p.sor3d_report,
                    ctx=g.ctx, **moved(g, x, p))
    files, log = g.pick(trained, lambda t: t.files), g.pick(trained, lambda t: t.log)
    shown   = g.named("record_model_train").add(training_record.run, log=log, files=files, params=training_record.Params(),
                                                ctx=g.ctx)
    films   = g.add(interaction_record.run, dataset=x.dataset, model=files,        params=p.interaction_record, ctx=g.ctx)
    g.target("sor3d", page, files, shown, films, record_run(g, "sor3d_report", page))


def sor3d_ablation(g: Graph, origin: Origin, p: Settings) -> None:
    """what each part of SOR3D-AFF's model is worth: rows of trainings over several seeds, or with --minutes what is finished by
    then; go on at will"""
    mine    = replace(p.sor3d_report, ablation=True)
    x       = lessons(g, origin, p)
    seeds   = range(mine.first_seed, mine.first_seed + mine.seeds)
    planned = recipes(mine.rows, seeds, p.sor3d_train.variant)
    q       = replace(p, sor3d_train=replace(p.sor3d_train, steps=mine.steps or p.sor3d_train.steps))
    kinds   = [tuple(one for one in planned if (label(one) == PRETRAINED) is late) for late in (False, True)]
    scores  = [examine(g, x.dataset, teach(g, origin, x.dataset, some, q), some, q, True) for some in kinds if some]
    more: dict[str, Any] = {"more": scores[1]} if scores[1:] else {}
    page    = g.add(sor3d_report.run, recipes=g.leaf("planned", planned), scores=scores[0], params=mine, ctx=g.ctx, **more,
                    **moved(g, x, p))
    g.target("sor3d-ablation", page, record_run(g, "sor3d_report", page))
