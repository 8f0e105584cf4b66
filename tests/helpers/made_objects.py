"""Small procedural objects with views, candidates and descriptions, for tests of negative affordance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from afford.surface.score.samples import part_targets
from maps.settings import Settings
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.surface import DistanceField, NegativeAffordances, PartCandidates, PartDescriptions, PartLessons, PartScores
from stages.surface import mask_propose, negative_affordance_projection, part_describe, part_lessons, view_render
from stages.synthetic import object_build
from tests.helpers.blocks import changed

FEW = dict.fromkeys(("train_per_category", "val_per_category", "seen_per_category", "unseen_per_category"), 1)
SMALL = Settings.of(object_plan=replace(Settings.synthetic.object_plan, categories=("screwdriver",), **FEW),
                    object_build=replace(Settings.synthetic.object_build, edge_m=0.02, max_faces=6000, atlas_px=64),
                    view_render=replace(Settings.surface.view_render, size_px=64, directions=32, share=0.0),
                    mask_propose=changed(Settings.surface.mask_propose, least_px=12),
                    scorer_train=replace(Settings.surface.scorer_train, steps=2, objects=1, candidates=2, warmup=1))  # fmt: skip
"""settings with which the whole chain takes a few seconds"""
GRID = mask_propose.Params(backend="grid")
VIEWS = view_render.Params(size_px=96, directions=64, most=8)


class Looked(NamedTuple):
    """Object with views, candidates, and its description by the lexicon."""

    spec: ObjectSpec
    mesh: ObjectMesh
    parts: MeshParts
    views: ObjectViews
    candidates: PartCandidates
    told: PartDescriptions

    def windows(self, params: mask_propose.Params = GRID) -> PartCandidates:
        return mask_propose.run(self.mesh, self.views, params)

    def lessons(self, most: int = 60) -> PartLessons:
        return part_lessons.run(self.spec, self.mesh, self.parts, self.views, self.candidates, part_lessons.Params(most))


@cache
def looked(category: str = "screwdriver", seed: int = 3, split: str = "train") -> Looked:
    """Build an object once for all tests of a process."""
    spec = ObjectSpec(f"{category}_{seed}", category, seed, "mixed", split)
    built = object_build.run(spec, object_build.Params(edge_m=0.012, max_faces=6000, atlas_px=128))
    views = view_render.run(built.mesh, VIEWS)
    found = mask_propose.run(built.mesh, views, changed(mask_propose.Params(), least_px=12))
    return Looked(spec, built.mesh, built.parts, views, found, part_describe.run(built.mesh, views, part_describe.Params()))


def between_nodes(grid: DistanceField) -> RegularGridInterpolator:
    """Trilinear interpolation of a distance field: points (n, 3) -> (n,) m."""
    axes = [grid.origin[k] + grid.spacing_m * np.arange(count) for k, count in enumerate(grid.distance_m.shape)]
    return RegularGridInterpolator(axes, grid.distance_m)


def true_scores(x: Looked, masks: PartCandidates | None = None) -> PartScores:
    """Return perfect scores of the object's candidates, or of other masks."""
    columns = [x.parts.names.index(note.part) for note in x.told.notes]
    share, overlap = (np.ascontiguousarray(found[:, columns]) for found in part_targets(x.parts, x.views, masks or x.candidates))
    return PartScores(x.mesh.name, share, overlap)


def projected(x: Looked, scores: PartScores | None = None) -> NegativeAffordances:
    """Project an object's scores, by default the true ones."""
    params = negative_affordance_projection.Params(spacing_m=0.02, negative_points=40, points=500)
    return negative_affordance_projection.run(x.mesh, x.views, x.candidates, x.told, scores or true_scores(x), params)
