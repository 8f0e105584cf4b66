"""Recorder of a trained part scorer: its curves, then its scores of candidates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from afford.common.image_files import jpeg
from afford.recording.mcap_files import Recording
from afford.recording.messages import SECOND_NS
from afford.recording.trainings import Preview, record_training, step_time_ns
from afford.surface.score.part_scorer import PartScorer
from afford.surface.score.preview import part_accuracy, predict_shares, preview_sheet
from schemas.surface import PartLessons
from schemas.training import TrainingLog


def record_scorer(curves: TrainingLog, stage: str, model: PartScorer, judged: Sequence[PartLessons], count: int) -> Recording:
    """Record the training of the stage `stage`, then a sheet for each of at most `count` objects, a second apart."""
    chosen = dict.fromkeys(np.linspace(0, len(judged) - 1, min(count, len(judged))).round().astype(int).tolist())
    return record_training(curves, stage, _sheets(curves, model, [judged[n] for n in chosen]))


def _sheets(curves: TrainingLog, model: PartScorer, judged: Sequence[PartLessons]) -> Iterator[Preview]:
    for n, one in enumerate(judged, 1):
        share = part_accuracy(predict_shares(model, one), one)
        text = f"{one.name}: {share:.0%} of candidates named right"
        yield Preview(step_time_ns(curves.steps) + n * SECOND_NS, jpeg(preview_sheet(model, one)), text)
