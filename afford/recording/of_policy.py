"""A trained policy -> its curves, then sample frames: episodes of it, drawn step by step, as in a recording of a training."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from afford.common.image_files import jpeg
from afford.grasping.env.rendering import DrawableEpisode
from afford.grasping.evaluate.trace_metrics import trace_metrics
from afford.recording.content import Recording
from afford.recording.of_grasp import times
from afford.recording.of_training import Shown, at, record
from afford.recording.topics import SECOND_NS
from schemas.training import TrainingLog

GAP_NS = SECOND_NS // 2
"""between the last step and the first episode, and between episodes"""


def policy(curves: TrainingLog, stage: str, episodes: Sequence[DrawableEpisode]) -> Recording:
    """The recording of the training `stage`; the episodes follow its last step."""
    return record(curves, stage, _frames(curves, episodes))


def _frames(curves: TrainingLog, episodes: Sequence[DrawableEpisode]) -> Iterator[Shown]:
    start = at(curves.steps) + GAP_NS
    for one in episodes:
        rows = times(one.trace, start)
        for row, time_ns in enumerate(rows):
            yield Shown(time_ns, jpeg(one.draw(row)), _words(one) if row == 0 else "")
        start = rows[-1] + GAP_NS


def _words(one: DrawableEpisode) -> str:
    """What the episode is about, and how it ends."""
    how = trace_metrics(one.trace, one.task)
    bad = ", ".join(one.task.negative) or "nothing"
    end = "reached the goal" if how.success[-1] else "never at the goal"
    return f"{one.task.name}: {one.task.use or 'any use'}; hold {one.task.hold or 'anything'}, not {bad}; {end}"
