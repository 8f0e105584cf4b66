"""The contact sheet of a recording of grasps: a strip for each episode, its moments spread evenly, with how it ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from afford.common.drawing import pad_tile, title_row
from afford.recording.moments import Moment, moments, tile_of
from afford.recording.of_grasp import IMAGE, SAID, STATE

SHOWN, SIDE, EPISODES = 6, 220, 8
"""moments of an episode, width of a tile in px, episodes at most"""


def is_grasp(path: Path) -> bool:
    """Whether a recording is of grasps."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return summary is not None and any(channel.topic == IMAGE for channel in summary.channels.values())


def strips_of(path: Path) -> list[np.ndarray]:
    """A line of words and a strip of pictures for each episode."""
    strips = []
    for episode in _episodes(path)[:EPISODES]:
        chosen = [episode[int(k)] for k in np.linspace(0, len(episode) - 1, SHOWN)]
        strip = np.concatenate([pad_tile(t) for moment in chosen if (t := tile_of(moment, IMAGE, "", SIDE)) is not None], axis=1)
        strips += [title_row([_words(episode)], strip.shape[1], SIDE), strip]
    return strips


def _episodes(path: Path) -> list[list[Moment]]:
    """Each begins with what is said of it."""
    found: list[list[Moment]] = []
    for moment in moments(path, [IMAGE, SAID, STATE]):
        if moment.one(SAID) is not None:
            found.append([])
        found[-1].append(moment)
    return found


def _words(episode: Sequence[Moment]) -> str:
    end = episode[-1].one(STATE)
    goal = "reached the goal" if end.success else "never at the goal"
    return f"{episode[0].one(SAID).message}   {goal}, {end.as_violation_pct:.0f} % of fingertips unsafe at the end"
