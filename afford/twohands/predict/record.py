"""An answer in numbers and words: the JSON object beside the masks (docs/twohands/predict.md names every field)."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.common.masks import box
from afford.twohands.predict.ask import Answer
from afford.twohands.predict.stored import Stored, unknown_words
from schemas.affordance import TAXONOMY
from schemas.benchmark import Prediction
from schemas.video import SIDES

DIGITS = 6


def record(answer: Answer, model: Stored) -> dict[str, Any]:
    """Everything about one answer that is not a picture, ready for JSON."""
    picture, prediction, question = answer.picture, answer.prediction, answer.question
    height, width = picture.rgb.shape[:2]
    video = {} if picture.frame is None else {"frame": picture.frame, "time_s": _round(picture.time_s or 0.0)}
    return {
        "source": picture.source, **video, "width_px": width, "height_px": height,
        "task": prediction.task,
        "unknown_words": unknown_words(model, prediction.task),
        "taxonomy": taxonomy(prediction),
        "hands_asked": question.hands,
        "hands": chosen(prediction),
        "threshold": _round(prediction.threshold),
        **{side: hand(prediction, n) for n, side in enumerate(SIDES)},
        "model": {"name": model.name, "digest": model.digest},
        "timing_ms": {"cpu": round(answer.cpu_ms, 3), "wall": round(answer.wall_ms, 3)},
    }  # fmt: skip


def brief(answer: Answer, folder: str) -> dict[str, Any]:
    """One line of the index of a call: where the record lies, and what it says in short."""
    picture, found = answer.picture, answer.prediction
    frame = {} if picture.frame is None else {"frame": picture.frame}
    scores = {side: _round(found.score[SIDES.index(side)].max()) for side in chosen(found)}
    return {"source": picture.source, **frame, "folder": folder, "taxonomy": taxonomy(found)["label"], "scores": scores}


def taxonomy(prediction: Prediction) -> dict[str, Any]:
    """The likeliest class by name, and the probability of each."""
    likely = {name: _round(value) for name, value in zip(TAXONOMY, prediction.taxonomy, strict=True)}
    return {"label": TAXONOMY[int(prediction.taxonomy.argmax())], "probabilities": likely}


def chosen(prediction: Prediction) -> list[str]:
    """The hands that are returned, by name."""
    return [side for side, used in zip(SIDES, prediction.hands, strict=True) if used]


def hand(prediction: Prediction, side: int) -> dict[str, Any]:
    """One hand: whether it is returned, which hypothesis is the best, and all of them."""
    return {
        "selected": bool(prediction.hands[side]),
        "best": int(prediction.score[side].argmax()),
        "area_share": _round(prediction.mask(side).mean()),
        "hypotheses": [_hypothesis(prediction, side, n) for n in range(prediction.score.shape[1])],
    }


def _hypothesis(prediction: Prediction, side: int, n: int) -> dict[str, Any]:
    probability = prediction.probability[side, n]
    region = probability > prediction.threshold
    return {"score": _round(prediction.score[side, n]), "area_share": _round(region.mean()), "box_px": _box(region),
            "largest_probability": _round(probability.max())}  # fmt: skip


def _box(region: np.ndarray) -> list[int] | None:
    """[left, top, right, bottom] in pixels, right and bottom not included; None for an empty region."""
    down, across = box(region)
    return [across.start, down.start, across.stop, down.stop] if region.any() else None


def _round(value: float | np.floating[Any]) -> float:
    return round(float(value), DIGITS)
