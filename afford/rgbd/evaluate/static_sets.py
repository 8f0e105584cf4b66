"""How well affordances of single pictures are told: figures of a whole set, a report, a sheet of confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.common.drawing import pad_tile, title_row, write_page
from afford.common.files import write_json
from afford.rgbd.evaluate import metrics as sor3d
from afford.rgbd.evaluate.drawn import heat, legend, painted
from afford.rgbd.evaluate.metrics import Counts
from afford.rgbd.model.static import Told, square
from schemas.interaction import AFFORDANCES, BACKGROUND, StaticSample

SIDE = 190
COLUMNS = ("picture", "true", "likeliest", "confident", "attention or box")
BOX = (255, 255, 255)


@dataclass(frozen=True)
class Scored:
    """A picture and what was said of it."""

    sample: StaticSample
    told: Told


@dataclass
class Tally:
    """Pixels of a whole set: of the likeliest of all classes, and of the likeliest of those that the set has."""

    classes: tuple[int, ...]
    """indices of the affordances that occur in the set"""
    free: Counts
    closed: Counts

    @classmethod
    def of(cls, samples: Sequence[StaticSample]) -> Tally:
        """Nothing yet. ValueError for a set without any affordance."""
        found = sorted({int(n) for one in samples for n in np.unique(square(one.label))} - {BACKGROUND})
        if not found:
            source = samples[0].source if samples else "samples"
            raise ValueError(f"{source}: expected pictures with an affordance in their middle, got none among {len(samples)}; are "
                             "the labels those of the set?")
        zero = np.zeros(len(AFFORDANCES), np.int64)
        return cls(tuple(found), Counts(zero, zero, zero), Counts(zero, zero, zero))

    def add(self, one: Scored) -> None:
        """One more picture."""
        truth, allowed = square(one.sample.label), [*self.classes, BACKGROUND]
        self.free += sor3d.counts(one.told.probability.argmax(0), truth)
        self.closed += sor3d.counts(np.array(allowed)[one.told.probability[allowed].argmax(0)], truth)

    def metrics(self) -> dict[str, float]:
        """iou, f, fw over the classes of the set, by class, and as closed.* when the model may say no other class."""
        return {**self._of(self.free), **{f"closed.{name}": value for name, value in self._of(self.closed).items()}}

    def _of(self, counts: Counts) -> dict[str, float]:
        """What is found of a class that the set lacks is a miss of the class that is there, and no class of its own."""
        kept = np.isin(np.arange(len(AFFORDANCES)), self.classes)
        only = Counts(counts.hit * kept, counts.found * kept, counts.true * kept)
        return {name: round(value, 6) for name, value in sor3d.summary(only).items()}


def write(root: Path, name: str, tally: Tally, count: int, shown: Sequence[Scored], threshold: float,
          refused: Sequence[str] = ()) -> Path:  # fmt: skip
    """metrics.json, report.md, sheet.png in `root`; `refused` says of pictures that were not scored why they could not be read."""
    metrics = tally.metrics()
    write_json(root / "metrics.json", metrics)
    (root / "report.md").write_text(_report(name, metrics, tally, count) + _missing(refused), encoding="utf-8")
    write_page(root / "sheet.png", sheet(shown, threshold))
    return root


def sheet(shown: Sequence[Scored], threshold: float) -> list[np.ndarray]:
    """Strips: titles, a row for each picture, the legend."""
    rows = [_row(one, threshold) for one in shown]
    width = rows[0].shape[1]
    key = legend(dict.fromkeys(AFFORDANCES, ""), f"confident: probability above {threshold:g}", width)
    return [title_row(COLUMNS, width, SIDE), *rows, key]


def _row(one: Scored, threshold: float) -> np.ndarray:
    rgb, probability = square(one.sample.rgb), one.told.probability
    sure = np.where(probability[:BACKGROUND].max(0) > threshold, probability[:BACKGROUND].argmax(0), BACKGROUND)
    looked = heat(one.told.attention, SIDE, SIDE) if one.told.attention.size else _boxed(rgb, one.told.box_px)
    tiles = [rgb, painted(rgb, square(one.sample.label)), painted(rgb, probability.argmax(0)), painted(rgb, sure), looked]
    return np.concatenate([pad_tile(cv2.resize(tile, (SIDE, SIDE), interpolation=cv2.INTER_AREA)) for tile in tiles], axis=1)


def _boxed(rgb: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    drawn = rgb.copy()
    for left, top, right, bottom in boxes.round().astype(int).tolist():
        cv2.rectangle(drawn, (left, top), (right - 1, bottom - 1), BOX, max(1, len(rgb) // 100))
    return drawn


def _missing(refused: Sequence[str]) -> str:
    """Pictures that have no part in the scores; nothing without any."""
    lines = "".join(f"- {sentence}\n" for sentence in refused)
    return f"\nNot scored, as they could not be read: {len(refused)}.\n\n{lines}" if refused else ""


def _report(name: str, metrics: dict[str, float], tally: Tally, count: int) -> str:
    names = [AFFORDANCES[n] for n in tally.classes]
    lines = [f"| {kind} | {metrics[f'iou.{kind}']:.3f} | {metrics[f'f.{kind}']:.3f} | {metrics[f'closed.iou.{kind}']:.3f} | "
             f"{metrics[f'closed.f.{kind}']:.3f} |" for kind in names]  # fmt: skip
    overall = (f"| all | {metrics['iou']:.3f} | {metrics['f']:.3f} | {metrics['closed.iou']:.3f} | {metrics['closed.f']:.3f} |\n\n"
               f"Weighted F (the paper's weights): {metrics['fw']:.3f}, closed {metrics['closed.fw']:.3f}.")  # fmt: skip
    return f"""# Affordances of single pictures: {name}

{count} pictures, each their middle square; a picture is a sequence of one frame in which nothing moves. Scores are of all pixels of
the set. `closed`: the model may only say what the set has ({', '.join(names)}) or background. Classes of the set that are none of
the nine affordances count as background.

| | IoU | F | IoU, closed | F, closed |
|---|--:|--:|--:|--:|
""" + "\n".join([*lines, overall]) + "\n"
