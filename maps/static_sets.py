"""Affordances of single pictures: the model of sequences beside a detector, on the same pictures, one line per stage."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from afford.rgbd.boxes import Boxes
from maps.recording import record_run
from maps.settings import Origin, Settings
from maps.sor3d import lessons, teach, usual
from runner import Graph
from schemas.files import FileTree
from schemas.interaction import InteractionClip, StaticSet
from stages.rgbd import static_evaluate, static_read, static_report
from stages.twohands import model_train

REPORTS = {"static_sor3d": ("sor3d", False), "static_boxes": ("boxes", False), "static_true_boxes": ("boxes", True)}
"""stages that report, in the order of Told: which model, whether it is told the box"""
HELD = "val"
"""of rendered sequences, those that nothing was learned from"""


class Told(NamedTuple):
    """Handles of the reports on one set of pictures."""

    ours: FileTree
    own_boxes: FileTree
    """of the detector, which proposes boxes itself"""
    true_boxes: FileTree
    """of the detector, which is told the box"""


def pictures(g: Graph, files: FileTree, p: Settings) -> StaticSet:
    """UMD or IIT-AFF, as `static_read.backend` says; no more of it than is asked about."""
    wanted  = replace(p.static_read, split=p.static_read.split or p.static_evaluate.split)
    return g.add(static_read.run, files=g.leaf("pictures", files),                                   params=wanted)


def detector(g: Graph, dataset: FileTree, p: Settings) -> FileTree:
    """The detector, trained on the last frames of the same data set as the model of sequences."""
    trained = g.named("boxes_train").add(model_train.run, dataset=dataset,           params=p.boxes_train, ctx=g.ctx)
    return g.pick(trained, lambda t: t.files)


def told(g: Graph, samples: StaticSet | tuple[InteractionClip, ...], model: FileTree, boxes: FileTree,
         p: Settings) -> Told:  # fmt: skip
    """Both models on the same pictures: `pictures`, or collected clips, of which the last frames of one split are taken."""
    models  = {"sor3d": model, "boxes": boxes}
    return Told(*(g.named(name).add(
        static_evaluate.run, samples=samples, model=models[backend],
        params=replace(p.static_evaluate, name=name, backend=backend, boxes=Boxes(true)), ctx=g.ctx)
        for name, (backend, true) in REPORTS.items()))  # fmt: skip


def static_sets(g: Graph, origin: Origin, p: Settings) -> None:
    """affordances of single pictures, by the model of `sor3d` and by a detector: of rendered interactions, UMD or IIT-AFF"""
    x       = lessons(g, origin, p)
    model   = g.pick(teach(g, origin, x.dataset, usual(p), p), lambda t: t.files)
    boxes   = detector(g, x.dataset, p)
    held    = replace(p, static_evaluate=replace(p.static_evaluate, split=p.static_evaluate.split or HELD))
    found   = (told(g, pictures(g, origin.pictures, p), model, boxes, p) if origin.pictures else
               told(g, g.collect(x.found.clip), model, boxes, held))  # fmt: skip
    table   = g.add(static_report.run,      reports=tuple(found),   params=static_report.Params(origin.name), ctx=g.ctx)
    g.target("static-sets", *found, table, *(record_run(g, name, files) for name, files in zip(REPORTS, found, strict=True)))
