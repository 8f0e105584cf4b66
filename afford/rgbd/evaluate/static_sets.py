"""Evaluation on single pictures: figures of a whole set, a report, a sheet of confident regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.common.drawing import pad_tile, title_row, write_page
from afford.common.files import write_json
from afford.rgbd.evaluate import metrics as sor3d
from afford.rgbd.evaluate.metrics import Counts
from afford.rgbd.model.predictor import PicturePrediction, middle_square
from afford.rgbd.prediction import attention_heat, legend, paint_regions
from schemas.interaction import AFFORDANCES, BACKGROUND, StaticSample

SIDE = 190
COLUMNS = ("picture", "true", "likeliest", "confident", "attention or box")
BOX = (255, 255, 255)


@dataclass(frozen=True)
class ScoredPicture:
    """A picture with its prediction."""

    sample: StaticSample
    prediction: PicturePrediction


@dataclass
class SetScores:
    """Pixel counts of a set: most likely of all classes, and most likely of the classes that the set has (closed)."""

    classes: tuple[int, ...]
    """indices of the affordances that occur in the set"""
    free: Counts
    closed: Counts

    @classmethod
    def of(cls, samples: Sequence[StaticSample]) -> SetScores:
        """Empty counts of a set. ValueError for a set without any affordance."""
        found = sorted({int(n) for one in samples for n in np.unique(middle_square(one.label))} - {BACKGROUND})
        if not found:
            source = samples[0].source if samples else "samples"
            raise ValueError(f"{source}: none of {len(samples)} pictures has an affordance in its middle square; check that "
                             "the labels are those of the set")
        zero = np.zeros(len(AFFORDANCES), np.int64)
        return cls(tuple(found), Counts(zero, zero, zero), Counts(zero, zero, zero))

    def add(self, one: ScoredPicture) -> None:
        """Count one more picture."""
        truth, allowed = middle_square(one.sample.label), [*self.classes, BACKGROUND]
        self.free += sor3d.counts(one.prediction.probability.argmax(0), truth)
        self.closed += sor3d.counts(np.array(allowed)[one.prediction.probability[allowed].argmax(0)], truth)

    def metrics(self) -> dict[str, float]:
        """iou, f, fw over the classes of the set and by class; as closed.* when the model is limited to those classes."""
        return {**self._of(self.free), **{f"closed.{name}": value for name, value in self._of(self.closed).items()}}

    def _of(self, counts: Counts) -> dict[str, float]:
        """Metrics over the classes of the set; a predicted class that the set lacks counts as a miss, not as a class."""
        kept = np.isin(np.arange(len(AFFORDANCES)), self.classes)
        only = Counts(counts.hit * kept, counts.found * kept, counts.true * kept)
        return {name: round(value, 6) for name, value in sor3d.summary(only).items()}


def write(root: Path, name: str, scores: SetScores, count: int, shown: Sequence[ScoredPicture], threshold: float,
          refused: Sequence[str] = ()) -> Path:  # fmt: skip
    """Write metrics.json, report.md and sheet.png to `root`; `refused` lists the errors of pictures that could not be read."""
    metrics = scores.metrics()
    write_json(root / "metrics.json", metrics)
    (root / "report.md").write_text(_report(name, metrics, scores, count) + _missing(refused), encoding="utf-8")
    write_page(root / "sheet.png", sheet(shown, threshold))
    return root


def sheet(shown: Sequence[ScoredPicture], threshold: float) -> list[np.ndarray]:
    """Strips of the sheet: titles, a row for each picture, the legend."""
    rows = [_row(one, threshold) for one in shown]
    width = rows[0].shape[1]
    key = legend(dict.fromkeys(AFFORDANCES, ""), f"confident: probability above {threshold:g}", width)
    return [title_row(COLUMNS, width, SIDE), *rows, key]


def _row(one: ScoredPicture, threshold: float) -> np.ndarray:
    rgb, probability = middle_square(one.sample.rgb), one.prediction.probability
    confident = np.where(probability[:BACKGROUND].max(0) > threshold, probability[:BACKGROUND].argmax(0), BACKGROUND)
    attention = one.prediction.attention
    last_tile = attention_heat(attention, SIDE, SIDE) if attention.size else _boxed(rgb, one.prediction.box_px)
    labels = (middle_square(one.sample.label), probability.argmax(0), confident)
    tiles = [rgb, *(paint_regions(rgb, label) for label in labels), last_tile]
    return np.concatenate([pad_tile(cv2.resize(tile, (SIDE, SIDE), interpolation=cv2.INTER_AREA)) for tile in tiles], axis=1)


def _boxed(rgb: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    drawn = rgb.copy()
    for left, top, right, bottom in boxes.round().astype(int).tolist():
        cv2.rectangle(drawn, (left, top), (right - 1, bottom - 1), BOX, max(1, len(rgb) // 100))
    return drawn


def _missing(refused: Sequence[str]) -> str:
    """List of the pictures that are not part of the scores; empty without any."""
    lines = "".join(f"- {sentence}\n" for sentence in refused)
    return f"\nNot scored, as they could not be read: {len(refused)}.\n\n{lines}" if refused else ""


def _report(name: str, metrics: dict[str, float], scores: SetScores, count: int) -> str:
    names = [AFFORDANCES[n] for n in scores.classes]
    lines = [f"| {kind} | {metrics[f'iou.{kind}']:.3f} | {metrics[f'f.{kind}']:.3f} | {metrics[f'closed.iou.{kind}']:.3f} | "
             f"{metrics[f'closed.f.{kind}']:.3f} |" for kind in names]  # fmt: skip
    overall = (f"| all | {metrics['iou']:.3f} | {metrics['f']:.3f} | {metrics['closed.iou']:.3f} | {metrics['closed.f']:.3f} |\n\n"
               f"Weighted F (the paper's weights): {metrics['fw']:.3f}, closed {metrics['closed.fw']:.3f}.")  # fmt: skip
    return f"""# Affordances of single pictures: {name}

{count} pictures, each their middle square; a picture is a sequence of one frame in which nothing moves. Scores are of all pixels of
the set. `closed`: the model may only say what the set has ({', '.join(names)}) or background. Classes of the set that are not among
the nine affordances count as background.

| | IoU | F | IoU, closed | F, closed |
|---|--:|--:|--:|--:|
""" + "\n".join([*lines, overall]) + "\n"
