"""Lines that the maps of several systems share: recordings, reports, and weights."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from maps.settings import Settings
from runner import Graph
from schemas.files import FileTree
from schemas.training import Trained
from stages.recording import run_record, training_record


def record_run(g: Graph, stage: str, files: FileTree) -> FileTree:
    """Record files that a stage over all clips wrote for people."""
    made = g.named(f"record_{stage}").add(run_record.run, files=files, params=run_record.Params(stage), ctx=g.ctx)
    return recorded(g, made, stage)


def record_training(g: Graph, stage: str, trained: Trained, params: Any) -> FileTree:
    """Record curves, sample pictures and parameters of a training."""
    log, files = g.pick(trained, lambda t: t.log), g.pick(trained, lambda t: t.files)
    made = g.named(f"record_{stage}").add(training_record.run, log=log, files=files, ctx=g.ctx,
                                          params=training_record.Params(stage, parameters(**{stage: params})))
    return recorded(g, made, stage)


def parameters(**stages: Any) -> tuple[tuple[str, str], ...]:
    """Convert the parameters of stages to the form that recordings contain."""
    return tuple((stage, json.dumps(asdict(params), sort_keys=True)) for stage, params in stages.items())


def recorded(g: Graph, recording: FileTree, name: str) -> FileTree:
    """Publish a recording among those of the source; `{clip}` gives one per clip."""
    return g.publish(recording, f"recordings/{{source}}/{name}.mcap", as_="recordings")


def reported(g: Graph, report: FileTree) -> FileTree:
    """Publish a report and its figures as those of the source."""
    return g.measure(g.publish(report, "reports/{source}", as_="report"))


def shipped(g: Graph, p: Settings, stage: str) -> FileTree | None:
    """Shipped files of the model that a stage trains; None where none are shipped, or parameters of the training were set."""
    files = dict(p.weights).get(f"shipped_{stage}")
    return None if files is None else g.leaf(f"shipped_{stage}", files)


def weights(g: Graph, p: Settings, stage: str) -> dict[str, FileTree]:
    """Argument `weights` of a stage; empty where its backend reads no weights, or no model is named.

    Weights are input files, so that a changed file reruns this stage alone.
    """
    found = dict(p.weights)
    return {"weights": g.leaf(f"{stage}_weights", found[stage])} if stage in found else {}
