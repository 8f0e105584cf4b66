"""Files of predictions: one folder for each picture, with masks, an overlay and a JSON record (docs/twohands/predict.md).

A folder is written under a temporary name, read back, and then renamed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.drawing import overlay
from afford.common.errors import SourceError
from afford.common.files import RECORD, replace_folder, write_json, write_verified
from afford.common.image_files import encode_png, mask_png
from afford.common.masks import box
from afford.twohands.inference import Answer
from afford.twohands.model.class_words import named_classes
from afford.twohands.model.model_folder import ModelFolder, read_config
from afford.twohands.model.stand_ins import unknown_words, words_read_as
from schemas.affordance import TAXONOMY
from schemas.benchmark import Prediction
from schemas.video import SIDES

DIGITS = 6


def record(answer: Answer, model: ModelFolder) -> dict[str, Any]:
    """Record of one answer, ready for JSON: all but the pictures."""
    picture, prediction, question = answer.picture, answer.prediction, answer.question
    height, width = picture.rgb.shape[:2]
    video = {} if picture.frame is None else {"frame": picture.frame, "time_s": _round(picture.time_s or 0.0)}
    return {
        "source": picture.source, **video, "width_px": width, "height_px": height,
        "task": prediction.task,
        "unknown_words": unknown_words(model, prediction.task),
        "read_as": words_read_as(model, prediction.task),
        "looked_for": looked_for(model, prediction.task),
        "taxonomy": taxonomy(prediction),
        "hands_asked": question.hands,
        "looks": question.looks,
        "hands": chosen(prediction),
        "threshold": _round(prediction.threshold),
        "present": _round(prediction.present),
        **{side: hand(prediction, n) for n, side in enumerate(SIDES)},
        **({"answer": prediction.answer} if prediction.answer else {}),
        "model": {"name": model.name, "digest": model.digest},
        "timing_ms": {"cpu": round(answer.cpu_ms, 3), "wall": round(answer.wall_ms, 3)},
    }  # fmt: skip


def looked_for(model: ModelFolder, task: str) -> list[str]:
    """Unknown words of a task for things that the model looks for by their classes of ImageNet."""
    unknown = unknown_words(model, task) or []
    if not unknown or not read_config(model.folder).classes:
        return []
    sought = set(named_classes(task))
    return [word for word in unknown if sought & set(named_classes(word))]


def brief(answer: Answer, folder: str) -> dict[str, Any]:
    """Entry of an answer in the index of a call: its folder, taxonomy, scores, and whether there are regions."""
    picture, found = answer.picture, answer.prediction
    frame = {} if picture.frame is None else {"frame": picture.frame}
    scores = {side: _round(found.score[SIDES.index(side)].max()) for side in chosen(found)}
    spoken = {"answer": found.answer} if found.answer else {}
    return {"source": picture.source, **frame, "folder": folder, "taxonomy": taxonomy(found)["label"], "scores": scores,
            "present": _round(found.present), "region": bool(found.mask(0).any() or found.mask(1).any()), **spoken}  # fmt: skip


def taxonomy(prediction: Prediction) -> dict[str, Any]:
    """Most probable class by name, and the probabilities of all classes."""
    likely = {name: _round(value) for name, value in zip(TAXONOMY, prediction.taxonomy, strict=True)}
    return {"label": TAXONOMY[int(prediction.taxonomy.argmax())], "probabilities": likely}


def chosen(prediction: Prediction) -> list[str]:
    """Names of the returned hands."""
    return [side for side, used in zip(SIDES, prediction.hands, strict=True) if used]


def hand(prediction: Prediction, side: int) -> dict[str, Any]:
    """Record of one hand: its selection, its best hypothesis, and all hypotheses."""
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
    """Bounding box [left, top, right, bottom] in pixels, right and bottom excluded; None for an empty region."""
    down, across = box(region)
    return [across.start, down.start, across.stop, down.stop] if region.any() else None


def _round(value: float | np.floating[Any]) -> float:
    return round(float(value), DIGITS)


OVERLAY, INDEX, INDEX_FORMAT = "overlay.png", "predictions.json", "afford-predictions-1"


def claim_folder(out: Path, force: bool) -> None:
    """Make the folder of a call, or reuse that of an earlier call. SourceError when it contains other files.

    The index is written first, so that the folder of an interrupted call is recognised.
    """
    own = (out / INDEX).is_file() and _format(out / INDEX) == INDEX_FORMAT
    if out.exists() and not out.is_dir():
        raise SourceError(str(out), "a folder", "a file", "give another --out")
    if not force and not own and out.exists() and any(out.iterdir()):
        raise SourceError(str(out), "a new or empty folder, or one of `predict`", "a folder with other files",
                          "give another --out, or --force to write into it")
    out.mkdir(parents=True, exist_ok=True)
    if not own:
        write_index(out, {})


def write_index(out: Path, content: dict[str, Any]) -> None:
    """Write predictions.json: the prompt of the last call, and the result of every picture."""
    partial = out / f".{INDEX}.partial-{os.getpid()}"
    write_json(partial, {"format": INDEX_FORMAT, **content})
    os.replace(partial, out / INDEX)


def write_prediction(answer: Answer, model: ModelFolder, out: Path, all_hypotheses: bool = False) -> Path:
    """Write the folder `<out>/<name of the picture>/` of an answer, and return it.

    It contains left.png and right.png (of the picture's size, 0 and 255), overlay.png, prediction.json and, with `all_hypotheses`,
    hypotheses/<side>_<n>.png. An earlier folder is replaced as a whole. SourceError when another folder has this name, OSError when
    a file does not read back as written.
    """
    folder = out / answer.picture.name
    with replace_folder(folder) as partial:
        for name, mask in _masks(answer, all_hypotheses):
            _save(partial / name, mask)
        drawn = overlay(answer.picture.rgb, answer.prediction)
        write_verified(partial / OVERLAY, encode_png(drawn[..., ::-1]).tobytes())
        write_json(partial / RECORD, record(answer, model))
    return folder


def _masks(answer: Answer, all_hypotheses: bool) -> Iterator[tuple[str, np.ndarray]]:
    found = answer.prediction
    for n, side in enumerate(SIDES):
        yield f"{side}.png", found.mask(n)
        for k in range(found.probability.shape[1] if all_hypotheses else 0):
            yield f"hypotheses/{side}_{k}.png", found.probability[n, k] > found.threshold


def _save(path: Path, mask: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    write_verified(path, mask_png(mask))
    back = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if back is None or not np.array_equal(back > 0, mask):
        raise OSError(f"{path}: expected the mask that was written, read something else; check the disk")


def _format(path: Path) -> str | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content.get("format") if isinstance(content, dict) else None
