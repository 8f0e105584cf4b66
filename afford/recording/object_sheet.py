"""The contact sheet of an object: its six views, the candidates of each, and where a hand must not go, or belongs, task by task."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from afford.common.drawing import pad_tile, title_row
from afford.recording import of_object, of_positive
from afford.recording.moments import moments, tile_of
from afford.recording.of_object import CANDIDATES, VIEW

SIX, SIDE, TASKS = 6, 190, 4
"""views, width of a tile in px, tasks at most"""
ROOMS = {of_object.ROOM: "not to be touched", of_positive.ROOM: "to be touched"}
"""first word of topics -> what is shown there"""


def is_object(path: Path) -> bool:
    """Whether a recording is of an object and not of a clip."""
    return VIEW in _topics(path)


def strips_of(path: Path) -> list[np.ndarray]:
    """A line of titles, then for views, candidates and each task a strip of six views."""
    shown = list(moments(path))[:SIX]
    there = _topics(path)
    tasks = sorted(topic for topic in there if _room(topic) in ROOMS and topic.endswith("/overlay"))[:TASKS]
    candidates = {"candidates": CANDIDATES} if CANDIDATES in there else {}
    layers = {path.stem: "", **candidates, **{_task(topic): topic for topic in tasks}}
    strips = []
    for title, overlay in layers.items():
        shades = _room(overlay) in ROOMS
        tiles = [pad_tile(t) for moment in shown if (t := tile_of(moment, VIEW, overlay, SIDE, not shades)) is not None]
        strip = np.concatenate(tiles, axis=1)
        strips += [title_row([title], strip.shape[1], SIDE), strip]
    return strips


def _task(topic: str) -> str:
    """/negative_affordance/0_cut_bread/overlay -> not to be touched: cut bread."""
    return f"{ROOMS[_room(topic)]}: " + topic.split("/")[2].partition("_")[2].replace("_", " ")


def _room(topic: str) -> str:
    return "/" + topic.split("/")[1] if topic else ""


def _topics(path: Path) -> set[str]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return {channel.topic for channel in summary.channels.values()} if summary else set()
