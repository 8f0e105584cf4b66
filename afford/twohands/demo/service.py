"""Prediction service of the demo: image bytes and a task in, one JSON object for the page out."""

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
"""largest side of the maps for the page, several times the input size of a model"""
MAX_TASK = 200
"""characters"""


class QuestionError(SourceError):
    """The task or the hands of a request are not valid."""


class PredictionService:
    """Model that serves one request at a time; safe to call from several threads."""

    def __init__(self, predictor: Predictor, model: ModelFolder) -> None:
        self._predictor, self._model, self._lock = predictor, model, threading.Lock()

    def about(self) -> dict[str, Any]:
        """Return the description of the model for the page."""
        config = self._predictor.model.config
        words = self._model.words
        return {"name": self._model.name, "digest": self._model.digest, "variant": config.variant, "threshold": config.threshold,
                "hypotheses": config.hypotheses, "words": words and {"verbs": words.verbs, "things": words.things}}  # fmt: skip

    def __call__(self, data: bytes, task: str, hands: str) -> dict[str, Any]:
        """Predict one picture; returns its record (`prediction_files.record`) with `maps`.

        `maps` are 8-bit PNG files of probabilities in base64, for each hand and hypothesis. QuestionError for a bad task or hands,
        SourceError (TooLargeError) for data that are not a picture.
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
