"""A picture as bytes and a task in; what the page shows out, as one object for JSON."""

from __future__ import annotations

import base64
import threading
from typing import Any

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.image_files import Picture, decode_image, grey_png
from afford.twohands.inference import Answer, Question, ask
from afford.twohands.model.hand_selection import HANDS
from afford.twohands.model.model_folder import ModelFolder
from afford.twohands.model.predictor import Predictor
from afford.twohands.prediction_files import record
from schemas.video import SIDES

MAX_PIXELS = 24_000_000
MAX_SIDE_PX = 960
"""the page gets maps of at most this size, which is several times what a model sees"""
MAX_TASK = 200
"""characters"""


class QuestionError(SourceError):
    """The task or the hands cannot be asked."""


class PredictionService:
    """A model that several visitors may ask; it answers one after another."""

    def __init__(self, predictor: Predictor, model: ModelFolder) -> None:
        self._predictor, self._model, self._lock = predictor, model, threading.Lock()

    def about(self) -> dict[str, Any]:
        """What the page says of the model."""
        config = self._predictor.model.config
        words = self._model.words
        return {"name": self._model.name, "digest": self._model.digest, "variant": config.variant, "threshold": config.threshold,
                "hypotheses": config.hypotheses, "words": words and {"verbs": words.verbs, "things": words.things}}  # fmt: skip

    def __call__(self, data: bytes, task: str, hands: str) -> dict[str, Any]:
        """The record of one answer (afford/twohands/prediction_files.py) and `maps`: per hand and hypothesis an 8-bit PNG of
        probabilities, in base64. QuestionError for a bad task or hands, SourceError (TooLargeError) for what is no picture.
        """
        words = " ".join(task.split())
        if not words or len(words) > MAX_TASK:
            raise QuestionError("task", f"1 to {MAX_TASK} characters", str(len(words)), "say it in a few words")
        if hands not in HANDS:
            raise QuestionError("hands", f"one of {', '.join(HANDS)}", repr(hands), "choose one of them")
        with self._lock:
            picture = Picture("picture", "picture", _shrunk(decode_image(data, "picture", MAX_PIXELS)))
            answer = ask(self._predictor, [picture], Question(words, hands))[0]
        return {**record(answer, self._model), "maps": _maps(answer)}


def _maps(answer: Answer) -> dict[str, list[str]]:
    grey = np.rint(answer.prediction.probability * 255).astype(np.uint8)
    return {side: [base64.b64encode(grey_png(one)).decode() for one in grey[n]] for n, side in enumerate(SIDES)}


def _shrunk(rgb: np.ndarray) -> np.ndarray:
    scale = MAX_SIDE_PX / max(rgb.shape[:2])
    size = max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale))
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
