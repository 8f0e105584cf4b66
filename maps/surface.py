"""Graph of negative affordance: from meshes to faces that a hand must not touch, one line per stage."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from afford.surface.describe.household import category_words
from maps.common import parameters, record_run, recorded, reported, shipped, weights
from maps.settings import Origin, Settings
from runner import Graph
from schemas.files import FileTree
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews, ReadMesh
from schemas.surface import NegativeAffordances, PartCandidates, PartDescriptions, PartLessons, PartScores
from schemas.training import Trained
from stages.recording import object_record, scorer_record
from stages.surface import (
    mask_propose,
    mask_score,
    mesh_read,
    mesh_texture,
    negative_affordance_files,
    negative_affordance_projection,
    negative_affordance_report,
    negative_affordance_score,
    part_describe,
    part_lessons,
    scorer_train,
    view_render,
)
from stages.synthetic import object_build, object_plan


class ObjectHandles(NamedTuple):
    """Handles of an object with views and candidates."""

    mesh: ObjectMesh
    parts: MeshParts
    views: ObjectViews
    candidates: PartCandidates
    costed: tuple[Any, ...] = ()
    """stages whose cost belongs to an object of the user, from its file on"""


def add_objects(g: Graph, of: str, plan: object_plan.Params, seen: view_render.Params,
                p: Settings) -> tuple[ObjectSpec, ObjectHandles]:  # fmt: skip
    """Add procedural objects of some splits, with views and candidates."""
    spec    = g.each(g.named(f"{of}_plan").add(object_plan.run,                                      params=plan))
    return spec, add_views(g, of, spec, seen, p)


def add_views(g: Graph, of: str, spec: ObjectSpec, seen: view_render.Params, p: Settings) -> ObjectHandles:
    """Add procedural objects, with views and candidates."""
    built   = g.named(f"{of}_build").add(object_build.run, spec=spec,                               params=p.synthetic.object_build)
    mesh, parts = g.pick(built, lambda b: b.mesh), g.pick(built, lambda b: b.parts)
    views   = g.named(f"{of}_views").add(view_render.run,  mesh=mesh,                                params=seen)
    masks   = g.named(f"{of}_masks").add(mask_propose.run, mesh=mesh, views=views,                   params=p.surface.mask_propose,
                                            **weights(g, p, "mask_propose"))
    return ObjectHandles(mesh, parts, views, masks, (views, masks))


def mesh_files(g: Graph, origin: Origin) -> FileTree:
    """Files of each of the user's meshes."""
    return g.each(g.leaf("meshes", origin.meshes))


def read_meshes(g: Graph, files: FileTree, p: Settings) -> ReadMesh:
    """Read the user's meshes."""
    return g.add(mesh_read.run,             files=files,
                 params=replace(p.surface.mesh_read, categories=category_words()))


def add_meshes(g: Graph, read: ReadMesh, p: Settings) -> ObjectHandles:
    """Add the user's meshes, with views and candidates, and with parts from label files."""
    mesh    = g.add(mesh_texture.run,       mesh=g.pick(read, lambda r: r.mesh),                     params=p.surface.mesh_texture)
    views   = g.named("object_views").add(view_render.run,  mesh=mesh,                               params=p.surface.view_render)
    masks   = g.named("object_masks").add(mask_propose.run, mesh=mesh, views=views,                  params=p.surface.mask_propose,
                                            **weights(g, p, "mask_propose"))
    return ObjectHandles(mesh, g.pick(read, lambda r: r.parts), views, masks, (read, mesh, views, masks))


class ScorerHandles(NamedTuple):
    """Handles of the part scorer and its training samples."""

    scorer: Trained
    lessons: tuple[PartLessons, ...]

    def files(self, g: Graph) -> FileTree:
        """Return the files of the scorer."""
        return g.pick(self.scorer, lambda t: t.files)


def train_scorer(g: Graph, p: Settings) -> ScorerHandles:
    """Train a part scorer on objects of the training categories."""
    spec, x = add_objects(g, "lesson", replace(p.synthetic.object_plan, splits=("train", "val")),
                   replace(p.surface.view_render, size_px=256, most=10, directions=128), p)
    lessons = g.add(part_lessons.run,       spec=spec, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates,
                    params=p.surface.part_lessons)
    every   = g.collect(lessons)
    trained = g.add(scorer_train.run,       lessons=every,                            params=p.surface.scorer_train, ctx=g.ctx)
    return ScorerHandles(trained, every)


def record_scorer(g: Graph, x: ScorerHandles, p: Settings) -> FileTree:
    """Record the training curves of the scorer and its predictions on validation objects."""
    log, mine = g.pick(x.scorer, lambda t: t.log), parameters(scorer_train=p.surface.scorer_train)
    made    = g.named("record_scorer_train").add(scorer_record.run, lessons=x.lessons, log=log, files=x.files(g), ctx=g.ctx,
                                                 params=scorer_record.Params(parameters=mine))
    return recorded(g, made, "scorer_train")


class AffordanceHandles(NamedTuple):
    """Handles of the descriptions, scores and negative affordance of an object."""

    notes: PartDescriptions
    fit: PartScores
    found: NegativeAffordances


def add_affordance(g: Graph, x: ObjectHandles, scorer: FileTree, p: Settings, of: str = "") -> AffordanceHandles:
    """Compute the negative affordance of an object; `of` is the prefix of the stage names."""
    notes   = g.named(f"{of}part_describe").add(part_describe.run, mesh=x.mesh, views=x.views,       params=p.surface.part_describe,
                    **weights(g, p, "part_describe"))
    fit     = g.named(f"{of}mask_score").add(mask_score.run, mesh=x.mesh, views=x.views, candidates=x.candidates,
                    descriptions=notes, scorer=scorer, params=p.surface.mask_score, **weights(g, p, "mask_score"))
    found   = g.named(f"{of}negative_affordance_projection").add(negative_affordance_projection.run, mesh=x.mesh, views=x.views,
                    candidates=x.candidates, descriptions=notes, scores=fit, params=p.surface.negative_affordance_projection)
    return AffordanceHandles(notes, fit, found)


def negative_affordance(g: Graph, origin: Origin, p: Settings) -> None:
    """Negative affordance of objects, or of the meshes of --source, for their tasks; scored where parts are known.

    Meshes of --source are scored by the shipped scorer, where there is one; without a source, a scorer is trained and measured.
    """
    ready   = shipped(g, p, "scorer_train") if origin.meshes else None
    if ready is not None:
        g.target("negative-affordance", *score_objects(g, origin, ready, p))
        return
    trained = train_scorer(g, p)
    g.target("negative-affordance", *score_objects(g, origin, trained.files(g), p), record_scorer(g, trained, p))


def score_objects(g: Graph, origin: Origin, scorer: FileTree, p: Settings) -> tuple[FileTree, FileTree, FileTree, FileTree]:
    """Negative affordance of objects with a scorer: files of each, recordings, the report, and its recording."""
    known: dict[str, ObjectSpec] = {}
    if origin.meshes:
        x = add_meshes(g, read_meshes(g, mesh_files(g, origin), p), p)
    else:
        plan = replace(p.synthetic.object_plan, splits=("seen", "unseen"))
        known["spec"], x = add_objects(g, "object", plan, p.surface.view_render, p)
    notes, fit, found = add_affordance(g, x, scorer, p)
    windows = g.named("object_windows").add(mask_propose.run, mesh=x.mesh, views=x.views,
                                            params=replace(p.surface.mask_propose, backend="grid"))
    fits    = g.named("window_score").add(mask_score.run, mesh=x.mesh, views=x.views, candidates=windows, descriptions=notes,
                                          scorer=scorer, params=p.surface.mask_score, **weights(g, p, "mask_score"))
    scores  = g.add(negative_affordance_score.run, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates,
                    descriptions=notes, scores=fit, windows=windows, window_scores=fits, found=found, **known,
                    params=replace(p.surface.negative_affordance_score,
                                   threshold=p.surface.negative_affordance_projection.threshold))
    files   = g.add(negative_affordance_files.run, mesh=x.mesh, descriptions=notes, found=found, ctx=g.ctx,
                    params=negative_affordance_files.Params())
    g.publish(files, "negative/{source}/{clip}", as_="negative")
    s       = p.surface
    mine    = parameters(view_render=s.view_render, mask_propose=s.mask_propose, part_describe=s.part_describe,
                         mask_score=s.mask_score, negative_affordance_projection=s.negative_affordance_projection)
    record  = g.add(object_record.run,      views=x.views, candidates=x.candidates, descriptions=notes, scores=fit, found=found,
                    mesh=x.mesh, ctx=g.ctx, params=object_record.Params("mesh_texture" if origin.meshes else "object_build", mine))
    report = g.add(negative_affordance_report.run, scores=g.collect(scores), params=p.surface.negative_affordance_report, ctx=g.ctx)
    g.cost("cpu_s_per_object", (*x.costed, notes, fit, found), (reported(g, report), "objects"), shards=scores)
    return files, recorded(g, record, "{clip}"), report, record_run(g, "negative_affordance_report", report)
