"""Recorder of trainings: curves as plottable numbers, previews as pictures, and the outcome as a log line.

TrainingLog and pictures -> /<stage>/<curve>, /<stage>/preview, /<stage>/log. A training has no media time: log time is the fixed
base of all recordings plus a millisecond per step. Results of the trained model, such as an episode of a policy, follow the last
step at their own rate.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from foxglove_schemas_protobuf.Log_pb2 import Log

from afford.recording.mcap_files import EPOCH_NS, Message, Recording
from afford.recording.messages import PAPER, Scalar, channel, image, image_channel, log, stamped
from schemas.files import FileTree
from schemas.training import TrainingLog

STEP_NS = 1_000_000
PICTURE = re.compile(r"previews/step_(\d+)\.jpg")


class Preview(NamedTuple):
    """A picture of a training, JPEG."""

    time_ns: int
    """log time"""
    jpeg: bytes
    words: str = ""
    """log line of the picture"""


def record_training(curves: TrainingLog, stage: str, shown: Iterable[Preview]) -> Recording:
    """Record one topic per curve (`train.total` is /<stage>/train/total), one for pictures if any, and a log."""
    pictures = list(shown)
    channels = [channel(_topic(stage, curve.name), Scalar) for curve in curves.curves]
    channels += [channel(f"/{stage}/log", Log), *([image_channel(f"/{stage}/preview")] if pictures else [])]
    return Recording(tuple(channels), sorted(_messages(curves, stage, pictures), key=lambda message: message.time_ns))


def previews(files: FileTree) -> list[Preview]:
    """Pictures that a training wrote, each at its step."""
    found = [(int(step[1]), file) for file in files.files if (step := PICTURE.fullmatch(file.name))]
    return [Preview(step_time_ns(step), file.path.read_bytes()) for step, file in found]


def step_time_ns(step: int) -> int:
    """Log time of a step."""
    return EPOCH_NS + step * STEP_NS


def _messages(curves: TrainingLog, stage: str, shown: list[Preview]) -> Iterator[Message]:
    for curve in curves.curves:
        for step, value in zip(curve.step.tolist(), curve.value.tolist(), strict=True):
            yield stamped(_topic(stage, curve.name), step_time_ns(step), Scalar(step=step, value=value))
    for one in shown:
        yield image(f"/{stage}/preview", one.time_ns, one.jpeg, "jpeg", PAPER)
        if one.words:
            yield log(f"/{stage}/log", one.time_ns, one.words, curves.name)
    text = f"{curves.steps} steps; the weights of step {curves.best_step} were kept"
    yield log(f"/{stage}/log", step_time_ns(curves.steps), text, curves.name)


def _topic(stage: str, name: str) -> str:
    return f"/{stage}/{name.replace('.', '/')}"
