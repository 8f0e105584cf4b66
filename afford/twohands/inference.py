"""A predictor, pictures and a question in; predictions and what they cost out."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from afford.common.errors import SourceError
from afford.common.image_files import Picture
from afford.common.video.inputs import Source, pictures
from afford.common.video.probe import probe
from afford.twohands.model.predictor import Predictor
from schemas.benchmark import Prediction


@dataclass(frozen=True)
class Question:
    """What is asked of every picture."""

    task: str
    hands: str = "auto"
    """auto: the taxonomy chooses; left, right, both: forced"""
    threshold: float | None = None
    """probability above which a pixel belongs to a region; None is the model's own"""


@dataclass(frozen=True)
class Answer:
    """What a model says of one picture."""

    picture: Picture
    question: Question
    prediction: Prediction
    cpu_ms: float
    """CPU time of all threads, from the picture in memory to probabilities at its own size; a batch's, shared out equally"""
    wall_ms: float


def ask(predictor: Predictor, pictures: Sequence[Picture], question: Question) -> list[Answer]:
    """One pass through the model for all pictures. ValueError for unknown hands."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = predictor.predict_batch([p.rgb for p in pictures], [question.task] * len(pictures), question.hands)
    cpu_ms = 1000 * (time.process_time() - cpu) / len(pictures)
    wall_ms = 1000 * (time.perf_counter() - wall) / len(pictures)
    if question.threshold is not None:
        found = [replace(prediction, threshold=question.threshold) for prediction in found]
    return [Answer(picture, question, one, cpu_ms, wall_ms) for picture, one in zip(pictures, found, strict=True)]


@dataclass(frozen=True)
class Refused:
    """A file that gave no picture, or no further one."""

    source: str
    message: str


def answer_all(predictor: Predictor, sources: Sequence[Source], question: Question, every: int, batch: int
            ) -> Iterator[Answer | Refused]:  # fmt: skip
    """In the order of the sources; refusals come as soon as they are met."""
    waiting: list[Picture] = []
    for item in _read(sources, every):
        if isinstance(item, Refused):
            yield item
            continue
        waiting.append(item)
        if len(waiting) == batch:
            yield from _asked(predictor, waiting, question)
            waiting = []
    if waiting:
        yield from _asked(predictor, waiting, question)


def picture_count(source: Source, every: int) -> int:
    """How many pictures a source is expected to give: 1 for an image, and for a video that cannot be read."""
    try:
        return len(range(0, len(probe(source.path).pts), every)) if source.is_video else 1
    except (ValueError, OSError):
        return 1


def _asked(predictor: Predictor, pictures: list[Picture], question: Question) -> list[Answer | Refused]:
    """One answer for each. Where a batch fails, each of its pictures is asked alone, and those that fail again are refused."""
    try:
        return [*ask(predictor, pictures, question)]
    except Exception as error:
        if len(pictures) > 1:
            return [item for picture in pictures for item in _asked(predictor, [picture], question)]
        return [_refused(pictures[0], error)]


def _refused(one: Picture, error: Exception) -> Refused:
    height, width = one.rgb.shape[:2]
    name = one.source if one.frame is None else f"{one.source}, frame {one.frame}"
    return Refused(one.source, f"{name}: expected a picture that the model can be asked about, got one of {width} x {height} "
                               f"pixels that ends in {type(error).__name__}: {error}; leave it out")  # fmt: skip


def _read(sources: Sequence[Source], every: int) -> Iterator[Picture | Refused]:
    for source in sources:
        try:
            yield from pictures(source, every)
        except SourceError as error:
            yield Refused(str(source.path), str(error))
