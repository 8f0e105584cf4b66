"""Answers as files: a folder per picture, written aside, read back, and only then put in its place."""

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
from afford.twohands.predict.ask import Answer
from afford.twohands.predict.record import record
from afford.twohands.predict.stored import Stored
from schemas.video import SIDES

OVERLAY, INDEX, FORMAT = "overlay.png", "predictions.json", "afford-predictions-1"


def claim(out: Path, force: bool) -> None:
    """Make the folder of a call, or go on in one that an earlier call made. SourceError when others' files lie in it.

    The index is written first, so that a call that was stopped left a folder that is known again.
    """
    own = (out / INDEX).is_file() and _format(out / INDEX) == FORMAT
    if out.exists() and not out.is_dir():
        raise SourceError(str(out), "a folder", "a file", "give another --out")
    if not force and not own and out.exists() and any(out.iterdir()):
        raise SourceError(str(out), "a new or empty folder, or one of `predict`", "a folder with other files",
                          "give another --out, or --force to write into it")
    out.mkdir(parents=True, exist_ok=True)
    if not own:
        index(out, {})


def index(out: Path, content: dict[str, Any]) -> None:
    """predictions.json: what the last call was asked, and what came of every picture."""
    partial = out / f".{INDEX}.partial-{os.getpid()}"
    write_json(partial, {"format": FORMAT, **content})
    os.replace(partial, out / INDEX)


def write(answer: Answer, model: Stored, out: Path, all_hypotheses: bool = False) -> Path:
    """Write `<out>/<name of the picture>/` and return it: left.png, right.png (of the picture's size, 0 and 255), overlay.png,
    prediction.json, and every hypothesis as hypotheses/<side>_<n>.png when asked. What was there before is replaced whole.
    SourceError when something else lies there, OSError when a file does not hold what was written.
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
