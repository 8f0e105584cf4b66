"""From nothing to a network that finds hands in pictures that nobody annotated."""

from __future__ import annotations

from maps.settings import Origin, Settings
from runner import Graph
from schemas.files import FileTree
from stages.extraction import hands_train
from stages.synthetic import hand_lessons, hand_plan


def finder(g: Graph, p: Settings) -> FileTree:
    """Rendered hands in rendered rooms -> the trained finder; whoever asks for it shares one training."""
    room    = g.each(g.add(hand_plan.run,                                                            params=p.hand_plan))
    lessons = g.add(hand_lessons.run,       room=room,                                params=p.hand_lessons, ctx=g.ctx)
    trained = g.add(hands_train.run,        lessons=g.collect(lessons),               params=p.hands_train, ctx=g.ctx)
    return g.pick(trained, lambda t: t.files)


def hands(g: Graph, origin: Origin, p: Settings) -> None:
    """a network that finds hands in pictures without masks, from rendered ones"""
    g.target("hands", finder(g, p))
