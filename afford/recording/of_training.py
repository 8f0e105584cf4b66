"""TrainingLog and pictures -> /model_train/<curve> as plottable numbers, /model_train/preview what the model said on the way.

A training has no media time: log time is the fixed base of all recordings, a millisecond per step.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from afford.recording.content import EPOCH_NS, Message, Recording
from afford.recording.own_types import Scalar
from afford.recording.topics import PAPER, channel, image, image_channel, stamped
from schemas.files import FileRef, FileTree
from schemas.training import TrainingLog

ROOM = "/model_train"
PREVIEW = f"{ROOM}/preview"
STEP_NS = 1_000_000
PICTURE = re.compile(r"previews/step_(\d+)\.jpg")


def record(log: TrainingLog, files: FileTree) -> Recording:
    """One topic per curve (`train.total` is /model_train/train/total), one for the previews."""
    pictures = [(int(found[1]), file) for file in files.files if (found := PICTURE.fullmatch(file.name))]
    channels = tuple(channel(_topic(curve.name), Scalar) for curve in log.curves)
    previews = (image_channel(PREVIEW),) if pictures else ()
    return Recording((*channels, *previews), sorted(_messages(log, pictures), key=lambda message: message.time_ns))


def _messages(log: TrainingLog, pictures: list[tuple[int, FileRef]]) -> Iterator[Message]:
    for curve in log.curves:
        for step, value in zip(curve.step.tolist(), curve.value.tolist(), strict=True):
            yield stamped(_topic(curve.name), _time(step), Scalar(step=step, value=value))
    for step, file in pictures:
        yield image(PREVIEW, _time(step), file.path.read_bytes(), "jpeg", PAPER)


def _topic(name: str) -> str:
    return f"{ROOM}/{name.replace('.', '/')}"


def _time(step: int) -> int:
    return EPOCH_NS + step * STEP_NS
