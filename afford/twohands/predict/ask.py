"""A predictor, pictures and a question in; predictions and what they cost out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from afford.common.image_files import Picture
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
