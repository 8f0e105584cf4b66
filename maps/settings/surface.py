"""Parameters of the surface system."""

from __future__ import annotations

from dataclasses import dataclass

from stages.surface import (
    mask_propose,
    mask_score,
    mesh_read,
    mesh_texture,
    negative_affordance_projection,
    negative_affordance_report,
    negative_affordance_score,
    part_describe,
    part_lessons,
    part_segment,
    positive_affordance_projection,
    scorer_train,
    view_render,
)


@dataclass(frozen=True)
class Surface:
    """Parameters of every stage of the system."""

    mesh_read: mesh_read.Params = mesh_read.Params()
    mesh_texture: mesh_texture.Params = mesh_texture.Params()
    view_render: view_render.Params = view_render.Params()
    mask_propose: mask_propose.Params = mask_propose.Params()
    part_lessons: part_lessons.Params = part_lessons.Params()
    scorer_train: scorer_train.Params = scorer_train.Params()
    part_describe: part_describe.Params = part_describe.Params()
    mask_score: mask_score.Params = mask_score.Params()
    part_segment: part_segment.Params = part_segment.Params()
    negative_affordance_projection: negative_affordance_projection.Params = negative_affordance_projection.Params()
    positive_affordance_projection: positive_affordance_projection.Params = positive_affordance_projection.Params()
    negative_affordance_score: negative_affordance_score.Params = negative_affordance_score.Params()
    negative_affordance_report: negative_affordance_report.Params = negative_affordance_report.Params()
