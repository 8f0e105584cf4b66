"""The models that stages ask for, found and digested: files among their inputs, so that a changed one reruns these stages alone."""

from __future__ import annotations

from dataclasses import dataclass

from maps.settings import Settings
from runner import Graph
from schemas.files import FileTree


@dataclass(frozen=True)
class Weighed(Settings):
    """Settings, and the files behind the `model` of every stage whose backend reads weights."""

    weights: tuple[tuple[str, FileTree], ...] = ()
    """(stage, files)"""


def weights(g: Graph, p: Settings, stage: str) -> dict[str, FileTree]:
    """The argument `weights` of a stage; none where its backend reads no weights, or nobody named any."""
    found = dict(p.weights) if isinstance(p, Weighed) else {}
    return {"weights": g.leaf(f"{stage}_weights", found[stage])} if stage in found else {}
