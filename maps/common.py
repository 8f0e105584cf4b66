"""What the maps of several systems share: recordings of what a run wrote for people, and models found and digested."""

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
    """What a run over all clips wrote for people -> its recording."""
    made = g.named(f"record_{stage}").add(run_record.run, files=files, params=run_record.Params(stage), ctx=g.ctx)
    return recorded(g, made, stage)


def record_training(g: Graph, stage: str, trained: Trained, params: Any) -> FileTree:
    """Curves and sample pictures of a training, and its parameters -> its recording."""
    log, files = g.pick(trained, lambda t: t.log), g.pick(trained, lambda t: t.files)
    made = g.named(f"record_{stage}").add(training_record.run, log=log, files=files, ctx=g.ctx,
                                          params=training_record.Params(stage, parameters(**{stage: params})))
    return recorded(g, made, stage)


def parameters(**stages: Any) -> tuple[tuple[str, str], ...]:
    """The parameters of stages as a recording of them carries these."""
    return tuple((stage, json.dumps(asdict(params), sort_keys=True)) for stage, params in stages.items())


def recorded(g: Graph, recording: FileTree, name: str) -> FileTree:
    """A recording, published among those of the source; `{clip}` is one for each clip."""
    return g.publish(recording, f"recordings/{{source}}/{name}.mcap", as_="recordings")


def reported(g: Graph, report: FileTree) -> FileTree:
    """A report, published as that of the source, and its figures."""
    return g.measure(g.publish(report, "reports/{source}", as_="report"))


def weights(g: Graph, p: Settings, stage: str) -> dict[str, FileTree]:
    """The argument `weights` of a stage; none where its backend reads no weights, or nobody named any. They are files among its
    inputs, so that a changed one reruns this stage alone.
    """
    found = dict(p.weights)
    return {"weights": g.leaf(f"{stage}_weights", found[stage])} if stage in found else {}
