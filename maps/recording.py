"""What a run wrote for people -> its recording."""

from __future__ import annotations

from runner import Graph
from schemas.files import FileTree
from stages.recording import run_record


def record_run(g: Graph, stage: str, files: FileTree) -> FileTree:
    """What a run over all clips wrote for people -> its recording."""
    return g.named(f"record_{stage}").add(run_record.run, files=files, params=run_record.Params(stage), ctx=g.ctx)
