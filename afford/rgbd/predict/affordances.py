"""What a sequence model says of one sequence, as files: labels, overlay, attention, probabilities, and all of it in numbers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from safetensors.numpy import save

from afford.common.drawing import MIN_WIDTH_PX
from afford.common.files import RECORD, write_files
from afford.common.image_files import encode_png
from afford.rgbd.evaluate import drawn
from afford.rgbd.model.found import Found, likeliest
from afford.rgbd.predict.footage import Footage
from schemas.interaction import AFFORDANCES, BACKGROUND

DIGITS = 6


@dataclass(frozen=True)
class Asked:
    """A sequence, where it came from, what was said of it and what that cost."""

    source: str
    footage: Footage
    found: Found
    flow: str
    """2d or 3d: motion that was seen; none where nothing moved or the model does not look at motion"""
    threshold: float
    """probability above which the overlay shows a region"""
    cpu_ms: float
    wall_ms: float


class Identified(Protocol):
    """A model on disk, as far as the record of a prediction states it."""

    @property
    def name(self) -> str:
        """Name of its folder."""

    @property
    def digest(self) -> str:
        """blake3 of its config and weights."""


def write(asked: Asked, model: Identified, folder: Path) -> Path:
    """label.png (indices, 9 where nothing is afforded), overlay.png, attention.png (of a model that attends),
    probabilities.safetensors and prediction.json. SourceError when something else lies there.
    """
    label, sure = (spread(asked, index) for index in (asked.found.label, asked.found.confident(asked.threshold)))
    said = record(asked, label, sure, model)
    files = {"label.png": encode_png(label).tobytes(), "overlay.png": _png(overlay(asked, sure, said)),
             "probabilities.safetensors": save({"probability": asked.found.probability, "action": asked.found.action,
                                                "attention": asked.found.attention}),
             RECORD: (json.dumps(said, indent=1, allow_nan=False) + "\n").encode()}  # fmt: skip
    if asked.found.attention.size:
        files["attention.png"] = _png(attention(asked))
    return write_files(folder, files)


def spread(asked: Asked, label: np.ndarray) -> np.ndarray:
    """(h, w) uint8 at the picture's own size, of labels at the model's; what the model does not see is BACKGROUND."""
    top, left, side = asked.footage.square
    whole = np.full(asked.footage.rgb.shape[:2], BACKGROUND, np.uint8)
    whole[top : top + side, left : left + side] = cv2.resize(label, (side, side), interpolation=cv2.INTER_NEAREST)
    return whole


def record(asked: Asked, label: np.ndarray, sure: np.ndarray, model: Identified) -> dict[str, Any]:
    """Everything that is not a picture (docs/twohands/predict.md). `label` and `sure` are at the picture's own size."""
    footage, found = asked.footage, asked.found
    top, left, side = footage.square
    return {
        "source": asked.source, **({} if footage.frame is None else {"frame": footage.frame}),
        "width_px": label.shape[1], "height_px": label.shape[0], "square_px": [left, top, left + side, top + side],
        "mode": "video" if len(footage.clip.rgb) > 1 else "picture", "frames": len(footage.clip.rgb),
        "rate_hz": footage.clip.rate_hz, "depth": footage.has_depth, "flow": asked.flow,
        "action": {"label": likeliest(found.action), "probabilities": _named(found.action)},
        "threshold": asked.threshold,
        "affordances": {name: _region(found, n, label, sure) for n, name in enumerate(AFFORDANCES)},
        "model": {"name": model.name, "digest": model.digest},
        "timing_ms": {"cpu": round(asked.cpu_ms, 3), "wall": round(asked.wall_ms, 3)},
    }  # fmt: skip


def overlay(asked: Asked, sure: np.ndarray, said: dict[str, Any]) -> np.ndarray:
    """(h', w', 3) uint8: the last picture with what is afforded with confidence, and a legend; small pictures are enlarged."""
    rgb = drawn.painted(asked.footage.rgb, sure)
    scale = max(1.0, MIN_WIDTH_PX / rgb.shape[1])
    size = round(rgb.shape[1] * scale), max(1, round(rgb.shape[0] * scale))
    shown = cv2.resize(rgb, size, interpolation=cv2.INTER_NEAREST) if scale > 1 else rgb
    words = {name: f"{one['confident_share']:.1%}" if one["confident_share"] else "" for name, one in said["affordances"].items()}
    action = said["action"]["label"]
    title = f"action: {action} ({said['action']['probabilities'][action]:.2f}); regions above {asked.threshold:g}"
    return np.vstack([shown, drawn.legend(words, title, size[0])])


def attention(asked: Asked) -> np.ndarray:
    """(side, side, 3) uint8: where the model looks in the square that it sees."""
    side = asked.footage.square[2]
    return drawn.heat(asked.found.attention, side, side)


def _region(found: Found, n: int, label: np.ndarray, sure: np.ndarray) -> dict[str, Any]:
    """Share of the picture, and the mean probability where it is the likeliest class; None where it nowhere is."""
    inside = found.label == n
    mean = round(float(found.probability[n][inside].mean()), DIGITS) if inside.any() else None
    return {"area_px": int(np.count_nonzero(label == n)), "area_share": round(float((label == n).mean()), DIGITS),
            "mean_confidence": mean, "confident_share": round(float((sure == n).mean()), DIGITS),
            "largest_probability": round(float(found.probability[n].max()), DIGITS)}  # fmt: skip


def _named(values: np.ndarray) -> dict[str, float]:
    return {name: round(float(value), DIGITS) for name, value in zip(AFFORDANCES, values, strict=True)}


def _png(rgb: np.ndarray) -> bytes:
    return encode_png(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)).tobytes()
