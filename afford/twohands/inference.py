"""Inference on pictures and videos of a user: prompt the predictor in batches, and measure the time.

A file that cannot be read, or a picture on which the model fails, is reported and skipped.
"""

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
    """Prompt for every picture."""

    task: str
    hands: str = "auto"
    """auto: selected by the taxonomy; left, right, both: forced"""
    threshold: float | None = None
    """probability above which a pixel belongs to a region; None is the model's own"""
    looks: int = 2
    """2: small objects are looked at again in their crop; 1: they are not"""


@dataclass(frozen=True)
class Answer:
    """Prediction for one picture, and its cost."""

    picture: Picture
    question: Question
    prediction: Prediction
    cpu_ms: float
    """CPU time of all threads, from the picture in memory to probabilities at its own size; divided equally within a batch"""
    wall_ms: float


def ask(predictor: Predictor, pictures: Sequence[Picture], question: Question) -> list[Answer]:
    """Predict all pictures in one batch. ValueError for unknown hands."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = predictor.predict_batch([p.rgb for p in pictures], [question.task] * len(pictures), question.hands,
                                    question.looks)
    cpu_ms = 1000 * (time.process_time() - cpu) / len(pictures)
    wall_ms = 1000 * (time.perf_counter() - wall) / len(pictures)
    if question.threshold is not None:
        found = [replace(prediction, threshold=question.threshold) for prediction in found]
    return [Answer(picture, question, one, cpu_ms, wall_ms) for picture, one in zip(pictures, found, strict=True)]


@dataclass(frozen=True)
class Refused:
    """File that cannot be read, or a picture on which the model failed."""

    source: str
    message: str


def answer_all(predictor: Predictor, sources: Sequence[Source], question: Question, every: int, batch: int
            ) -> Iterator[Answer | Refused]:  # fmt: skip
    """Predict the pictures of all sources in batches, in order; refusals are yielded at once."""
    waiting: list[Picture] = []
    for item in _read(sources, every):
        if isinstance(item, Refused):
            yield item
            continue
        waiting.append(item)
        if len(waiting) == batch:
            yield from _predict_batch(predictor, waiting, question)
            waiting = []
    if waiting:
        yield from _predict_batch(predictor, waiting, question)


def picture_count(source: Source, every: int) -> int:
    """Expected number of pictures of a source; 1 for an image, or for a video that cannot be read."""
    try:
        return len(range(0, len(probe(source.path).pts), every)) if source.is_video else 1
    except (ValueError, OSError):
        return 1


def _predict_batch(predictor: Predictor, pictures: list[Picture], question: Question) -> list[Answer | Refused]:
    """Predict a batch. When it fails, its pictures are predicted one by one, and those that fail again are refused."""
    try:
        return [*ask(predictor, pictures, question)]
    except Exception as error:
        if len(pictures) > 1:
            return [item for picture in pictures for item in _predict_batch(predictor, [picture], question)]
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
