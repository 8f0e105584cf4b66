"""RGB-D interactions: rendered, or those of a root in the layout of SOR3D-AFF, one line per stage."""

from __future__ import annotations

from typing import NamedTuple

from maps.settings import Origin, Settings
from runner import Graph
from schemas.interaction import InteractionClip, InteractionTruth
from stages.rgbd import interaction_read
from stages.synthetic import interaction_plan, interaction_render


class Interactions(NamedTuple):
    """Handles of one sequence; what is true of it where it was made (otherwise None)."""

    clip: InteractionClip
    truth: InteractionTruth | None


def sequences(g: Graph, origin: Origin, p: Settings) -> Interactions:
    """Every sequence of the source; both ways go through the same files and the same reader."""
    if origin.sequences:
        given = g.each(g.leaf("sequences", origin.sequences))
        return Interactions(g.add(interaction_read.run, files=given,                 params=p.interaction_read), None)
    spec    = g.each(g.add(interaction_plan.run,                                     params=p.interaction_plan))
    made    = g.add(interaction_render.run, spec=spec,                               params=p.interaction_render, ctx=g.ctx)
    clip    = g.add(interaction_read.run,   files=g.pick(made, lambda m: m.files),   params=p.interaction_read)
    return Interactions(clip, g.pick(made, lambda m: m.truth))


def interactions(g: Graph, origin: Origin, p: Settings) -> None:
    """RGB-D sequences of people who use things, with the affordance of the last frame"""
    found = sequences(g, origin, p)
    g.target("interactions", found.clip, *([] if found.truth is None else [found.truth]))
