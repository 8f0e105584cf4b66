"""Prediction of a sequence model: its values, pictures of them, and the files of `predict`.

The colours of mask files (`COLOURS_BGR`) are nearly all greens; the colours here are for display only.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from PIL import Image, ImageDraw
from safetensors.numpy import save

from afford.common.drawing import MIN_WIDTH_PX, font
from afford.common.files import RECORD, write_files
from afford.common.image_files import encode_png
from afford.common.palette import FAINT, INK, PAPER, Colour
from afford.rgbd.footage import Footage
from schemas.interaction import AFFORDANCES, BACKGROUND

CONFIDENT = 0.75
"""probability above which the paper shows a region"""


@dataclass(frozen=True)
class Prediction:
    """Prediction of the last frame of a sequence, at the size of the model's input."""

    probability: np.ndarray
    """(10, h, w) float32 by AFFORDANCES and, last, BACKGROUND; sums to 1 over the first axis"""
    action: np.ndarray
    """(9,) float32 by AFFORDANCES, sums to 1"""
    attention: np.ndarray
    """(h', w') float32 over the latent, sums to 1; (0, 0) without attention"""

    @property
    def label(self) -> np.ndarray:
        """Most likely class of each pixel, (h, w) uint8."""
        return self.probability.argmax(0).astype(np.uint8)

    def confident(self, threshold: float = CONFIDENT) -> np.ndarray:
        """Affordance of each pixel with a probability above `threshold`, (h, w) uint8; BACKGROUND elsewhere."""
        best = self.probability[:BACKGROUND]
        return np.where(best.max(0) > threshold, best.argmax(0), BACKGROUND).astype(np.uint8)


def likeliest_action(action: np.ndarray) -> str:
    """Name of the most likely action."""
    return AFFORDANCES[int(action.argmax())]


COLOURS: dict[str, Colour] = {
    "grasp": (0, 158, 115), "cut": (230, 159, 0), "lift": (0, 114, 178), "push": (204, 121, 167), "rotate": (240, 228, 66),
    "hammer": (213, 94, 0), "squeeze": (86, 180, 233), "paint": (148, 82, 200), "type": (220, 50, 60)}  # fmt: skip
"""the seven colours of Okabe and Ito, violet and red"""
OPACITY = 0.55


def paint_regions(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Tint a picture with the colours of the regions of `label` (h, w); (h, w, 3) uint8."""
    table = np.array([*(COLOURS[name] for name in AFFORDANCES), (0, 0, 0)], np.float32)
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    return np.asarray((rgb * (1 - weight) + table[label] * weight).round().astype(np.uint8))


def attention_heat(attention: np.ndarray, height_px: int, width_px: int) -> np.ndarray:
    """Heat map (h, w, 3) uint8 RGB of an attention map (h', w'), scaled to its maximum, in nearest cells as in the model."""
    grey = (255 * attention / max(float(attention.max(initial=0)), 1e-12)).round().astype(np.uint8)
    if not grey.size:
        grey = np.zeros((1, 1), np.uint8)
    large = cv2.resize(grey, (width_px, height_px), interpolation=cv2.INTER_NEAREST)
    return cv2.cvtColor(cv2.applyColorMap(large, cv2.COLORMAP_INFERNO), cv2.COLOR_BGR2RGB)


def legend(texts: Mapping[str, str], title: str, width_px: int) -> np.ndarray:
    """Legend (h, width_px, 3) uint8: a title line above a swatch and a text for each affordance."""
    unit = max(13, width_px // 40)
    columns = max(1, width_px // (13 * unit))
    rows = -(-len(texts) // columns)
    page = Image.new("RGB", (width_px, round((2.4 + 1.6 * rows) * unit)), PAPER)
    draw = ImageDraw.Draw(page)
    draw.text((unit, round(0.5 * unit)), title, INK, font(round(1.05 * unit), bold=True))
    for n, (name, words) in enumerate(texts.items()):
        x, y = unit + (n % columns) * ((width_px - unit) // columns), round((2.1 + 1.6 * (n // columns)) * unit)
        draw.rounded_rectangle((x, y, x + unit, y + unit), unit // 5, COLOURS[name])
        draw.text((x + round(1.5 * unit), y + unit // 2), f"{name} {words}", INK if words else FAINT, font(round(0.85 * unit)),
                  anchor="lm")  # fmt: skip
    return np.asarray(page)


DIGITS = 6


@dataclass(frozen=True)
class SequencePrediction:
    """Prediction of one sequence with its source, its threshold and its cost."""

    source: str
    footage: Footage
    found: Prediction
    flow: str
    """motion that the model used, 2d or 3d; none for a still input or a model without motion"""
    threshold: float
    """probability above which the overlay shows a region"""
    cpu_ms: float
    wall_ms: float


class Identified(Protocol):
    """Name and digest of a model on disk, for the record of a prediction."""

    @property
    def name(self) -> str:
        """Name of the model's folder."""

    @property
    def digest(self) -> str:
        """blake3 of its config and weights."""


def write_prediction(result: SequencePrediction, model: Identified, folder: Path) -> Path:
    """Write label.png, overlay.png, attention.png, probabilities.safetensors and prediction.json.

    label.png holds indices, 9 for background; attention.png is written for models with attention only. SourceError when the
    folder holds other files.
    """
    label, confident = (full_size(result, index) for index in (result.found.label, result.found.confident(result.threshold)))
    facts = record(result, label, confident, model)
    files = {"label.png": encode_png(label).tobytes(), "overlay.png": _png(overlay(result, confident, facts)),
             "probabilities.safetensors": save({"probability": result.found.probability, "action": result.found.action,
                                                "attention": result.found.attention}),
             RECORD: (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode()}  # fmt: skip
    if result.found.attention.size:
        files["attention.png"] = _png(attention_picture(result))
    return write_files(folder, files)


def full_size(result: SequencePrediction, label: np.ndarray) -> np.ndarray:
    """Labels (h, w) uint8 at the picture's own size from labels at the model's; BACKGROUND outside the model's square."""
    top, left, side = result.footage.square
    whole = np.full(result.footage.rgb.shape[:2], BACKGROUND, np.uint8)
    whole[top : top + side, left : left + side] = cv2.resize(label, (side, side), interpolation=cv2.INTER_NEAREST)
    return whole


def record(result: SequencePrediction, label: np.ndarray, confident: np.ndarray, model: Identified) -> dict[str, Any]:
    """Contents of prediction.json (docs/twohands/predict.md); `label` and `confident` have the picture's own size."""
    footage, found = result.footage, result.found
    top, left, side = footage.square
    return {
        "source": result.source, **({} if footage.frame is None else {"frame": footage.frame}),
        "width_px": label.shape[1], "height_px": label.shape[0], "square_px": [left, top, left + side, top + side],
        "mode": "video" if len(footage.clip.rgb) > 1 else "picture", "frames": len(footage.clip.rgb),
        "rate_hz": footage.clip.rate_hz, "depth": footage.has_depth, "flow": result.flow,
        "action": {"label": likeliest_action(found.action), "probabilities": _named(found.action)},
        "threshold": result.threshold,
        "affordances": {name: _region(found, n, label, confident) for n, name in enumerate(AFFORDANCES)},
        "model": {"name": model.name, "digest": model.digest},
        "timing_ms": {"cpu": round(result.cpu_ms, 3), "wall": round(result.wall_ms, 3)},
    }  # fmt: skip


def overlay(result: SequencePrediction, confident: np.ndarray, facts: dict[str, Any]) -> np.ndarray:
    """Last picture with its confident regions and a legend, (h', w', 3) uint8; small pictures are enlarged."""
    rgb = paint_regions(result.footage.rgb, confident)
    scale = max(1.0, MIN_WIDTH_PX / rgb.shape[1])
    size = round(rgb.shape[1] * scale), max(1, round(rgb.shape[0] * scale))
    shown = cv2.resize(rgb, size, interpolation=cv2.INTER_NEAREST) if scale > 1 else rgb
    words = {name: f"{one['confident_share']:.1%}" if one["confident_share"] else "" for name, one in facts["affordances"].items()}
    action = facts["action"]["label"]
    title = f"action: {action} ({facts['action']['probabilities'][action]:.2f}); regions above {result.threshold:g}"
    return np.vstack([shown, legend(words, title, size[0])])


def attention_picture(result: SequencePrediction) -> np.ndarray:
    """Attention map over the square that the model sees, (side, side, 3) uint8."""
    side = result.footage.square[2]
    return attention_heat(result.found.attention, side, side)


def _region(found: Prediction, n: int, label: np.ndarray, confident: np.ndarray) -> dict[str, Any]:
    """Area of one affordance and its mean probability where it is the most likely class (None without such pixels)."""
    inside = found.label == n
    mean = round(float(found.probability[n][inside].mean()), DIGITS) if inside.any() else None
    return {"area_px": int(np.count_nonzero(label == n)), "area_share": round(float((label == n).mean()), DIGITS),
            "mean_confidence": mean, "confident_share": round(float((confident == n).mean()), DIGITS),
            "largest_probability": round(float(found.probability[n].max()), DIGITS)}  # fmt: skip


def _named(values: np.ndarray) -> dict[str, float]:
    return {name: round(float(value), DIGITS) for name, value in zip(AFFORDANCES, values, strict=True)}


def _png(rgb: np.ndarray) -> bytes:
    return encode_png(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)).tobytes()
