"""Affordances of single pictures: the model of sequences beside a detector, on the same pictures, one line per stage."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from maps.settings import Settings
from runner import Graph
from schemas.files import FileTree
from schemas.interaction import InteractionClip, StaticSample
from stages import model_train, static_evaluate, static_read


class Told(NamedTuple):
    """Handles of the reports on one set of pictures."""

    ours: FileTree
    own_boxes: FileTree
    """of the detector, which proposes boxes itself"""
    true_boxes: FileTree
    """of the detector, which is told the box"""


def pictures(g: Graph, files: FileTree, p: Settings) -> tuple[StaticSample, ...]:
    """UMD or IIT-AFF, as `static_read.backend` says."""
    return g.add(static_read.run, files=g.leaf("pictures", files),                                   params=p.static_read)


def detector(g: Graph, dataset: FileTree, p: Settings) -> FileTree:
    """The detector, trained on the last frames of the same data set as the model of sequences."""
    trained = g.named("boxes_train").add(model_train.run, dataset=dataset,           params=p.boxes_train, ctx=g.ctx)
    return g.pick(trained, lambda t: t.files)


def told(g: Graph, samples: tuple[StaticSample, ...] | tuple[InteractionClip, ...], model: FileTree, boxes: FileTree,
         p: Settings) -> Told:  # fmt: skip
    """Both models on the same pictures: `pictures`, or collected clips, of which the last frames of one split are taken."""
    usual, found = p.static_evaluate, []
    for name, of, backend, true in (("static_sor3d", model, "sor3d", False), ("static_boxes", boxes, "boxes", False),
                                    ("static_true_boxes", boxes, "boxes", True)):  # fmt: skip
        params = replace(usual, name=name, backend=backend, true_boxes=true)
        found.append(g.named(name).add(static_evaluate.run, samples=samples, model=of, params=params, ctx=g.ctx))
    return Told(*found)
