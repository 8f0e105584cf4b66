"""Scores of one method on all cases, by the strict measures and by those of the released script."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from afford.common.masks import iou
from afford.twohands.benchmark import compat, measures
from afford.twohands.benchmark.answers import Answer
from schemas.affordance import Taxonomy
from schemas.benchmark import Case, MethodScores, Sheet
from schemas.video import SIDES

NAN = float("nan")
MEASURES = (
    "iou", "precision", "recall", "f1", "hd_px", "hd_symmetric_px", "map",
    "hand_iou", *(f"{hand}.{name}" for hand in SIDES for name in measures.Overlap._fields),
    "first_mode_iou", "best_mode_iou", "best_hypothesis_iou",
    "taxonomy_accuracy", "taxonomy_open_accuracy", "hands_accuracy", "taxonomy_confidence",
    "spurious", "spurious_unselected", "missed", "answered",
)  # fmt: skip
"""defined in docs/twohands/benchmark.md"""


class Row(NamedTuple):
    """Scores of one case."""

    case_id: str
    protocol: str
    groups: tuple[str, ...]
    notes: tuple[str, ...]
    task: str
    taxonomy: tuple[int, ...]
    """taxonomy of each mode"""
    values: dict[str, float]
    compat: np.ndarray
    """(l, 4)"""
    found: int
    """predicted taxonomy, -1 without one"""
    reliability: np.ndarray

    @property
    def valid(self) -> frozenset[int]:
        """Taxonomies of the valid modes."""
        return frozenset(self.taxonomy) - {int(Taxonomy.NONE)}


def score(name: str, cases: Iterable[Case], levels: tuple[float, ...], answer: Callable[[Case], Answer], floor: float,
          sheets: Callable[[list[str], np.ndarray], tuple[Sheet, ...]]) -> MethodScores:  # fmt: skip
    """Score a method on all cases.

    `floor` is the probability below which pixels do not count for calibration. `sheets` draws cases, given their ids and IoU.
    """
    rows = [score_case(case, answer(case), floor) for case in cases]
    _add_open(rows)
    ids = [row.case_id for row in rows]
    values = np.array([[row.values[column] for column in MEASURES] for row in rows])
    return MethodScores(
        name=name,
        case_id=tuple(ids),
        protocol=tuple(row.protocol for row in rows),
        groups=tuple(row.groups for row in rows),
        notes=tuple(row.notes for row in rows),
        measure=MEASURES,
        values=values,
        level=levels,
        compat=np.stack([row.compat for row in rows]),
        taxonomy_true=np.array([_true(row) for row in rows], np.int8),
        taxonomy_found=np.array([row.found for row in rows], np.int8),
        reliability=np.stack([row.reliability for row in rows]),
        sheets=sheets(ids, values[:, MEASURES.index("iou")]),
    )


def score_case(case: Case, prediction: Answer, floor: float) -> Row:
    """Compute all measures of one case."""
    union = prediction.top[0] | prediction.top[1]
    mode = case.modes[measures.best_mode(union, case.modes)]
    truth = mode[0] | mode[1]
    table = measures.agreement(prediction.proposals, case.modes)
    values = {
        **measures.overlap(union, truth)._asdict(),
        **dict(zip(("hd_px", "hd_symmetric_px"), measures.hausdorff(union, truth), strict=True)),
        "map": float(np.mean([_best_precision(cut[0] | cut[1], case.modes) for cut in prediction.cuts])),
        **_per_hand(prediction.top, mode),
        "first_mode_iou": iou(union, case.modes[0, 0] | case.modes[0, 1]),
        "best_mode_iou": measures.best_mode_iou(table),
        "best_hypothesis_iou": measures.best_hypothesis_iou(table),
        **_hands(prediction, case.modes, mode),
        "answered": float(any(file is not None for pair in prediction.files for file in pair)),
    }
    found = -1 if prediction.taxonomy is None else int(prediction.taxonomy.argmax())
    taxonomy = tuple(int(one) for one in case.taxonomy)
    row = Row(case.case_id, case.protocol, case.groups, case.notes, case.task, taxonomy, values, _compat(case, prediction), found,
              _reliability(case, prediction, floor))
    known = prediction.taxonomy is not None and bool(row.valid)
    values["taxonomy_accuracy"] = float(found in row.valid) if known else NAN
    values["taxonomy_confidence"] = float(prediction.taxonomy.max()) if prediction.taxonomy is not None and known else NAN
    return row


def _best_precision(found: np.ndarray, all_modes: np.ndarray) -> float:
    """Precision against the mode with the best IoU."""
    mode = all_modes[measures.best_mode(found, all_modes)]
    return measures.precision(found, mode[0] | mode[1])


def _per_hand(top: np.ndarray, mode: np.ndarray) -> dict[str, float]:
    """Overlaps of the hands of a mode; `hand_iou` is the mean over hands in the mode or returned, 0 for a hand too many."""
    out: dict[str, float] = {}
    ious: list[float] = []
    for hand, found, truth in zip(SIDES, top, mode, strict=True):
        needed = bool(truth.any())
        scores = measures.overlap(found, truth) if needed else measures.Overlap(NAN, NAN, NAN, NAN)
        out |= {f"{hand}.{name}": value for name, value in scores._asdict().items()}
        if needed or found.any():
            ious.append(scores.iou if needed else 0.0)
    return out | {"hand_iou": float(np.mean(ious))}


def _hands(prediction: Answer, all_modes: np.ndarray, mode: np.ndarray) -> dict[str, float]:
    """Measures of the returned hands against those of the valid modes."""
    returned, needed = _some(prediction.top), _some(mode)
    takes = np.stack([_some(one) for one in all_modes])
    idle = ~takes.any(axis=0)
    without = None if prediction.unselected is None else _some(prediction.unselected)
    return {
        "hands_accuracy": float((takes == returned).all(axis=1).any()),
        "spurious": float(returned[idle].any()) if idle.any() else NAN,
        "spurious_unselected": float(without[idle].any()) if idle.any() and without is not None else NAN,
        "missed": float(np.mean(~returned[needed])),
    }


def _some(pair: np.ndarray) -> np.ndarray:
    """Hands (2,) bool that have a region."""
    return np.array([mask.any() for mask in pair])


def _compat(case: Case, prediction: Answer) -> np.ndarray:
    truth = tuple(mask for mask in case.modes[0] if mask.any())
    scores = [compat.case_score(truth, pair) for pair in prediction.files]
    return np.array([(NAN,) * 4 if one is None else tuple(one) for one in scores], np.float64)


def _reliability(case: Case, prediction: Answer, floor: float) -> np.ndarray:
    if prediction.marginal is None:
        return np.zeros((3, measures.BINS))
    held = case.modes.sum(axis=0, dtype=np.uint8)
    pairs = zip(prediction.marginal, held, strict=True)
    return np.sum([measures.reliability(p, hand, len(case.modes), floor) for p, hand in pairs], axis=0)


def _add_open(rows: list[Row]) -> None:
    """Add `taxonomy_open_accuracy`, for cases whose task does not determine the hands: no class is valid for all its cases."""
    by_task: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        by_task[row.protocol, row.task.lower()].append(row)
    for alike in by_task.values():
        shared = frozenset.intersection(*(row.valid for row in alike))
        for row in alike:
            row.values["taxonomy_open_accuracy"] = NAN if shared else row.values["taxonomy_accuracy"]


def _true(row: Row) -> int:
    """True class for the confusion table: the predicted one if it is valid, else that of the first mode."""
    if row.found in row.valid:
        return row.found
    return next((one for one in row.taxonomy if one != Taxonomy.NONE), int(Taxonomy.NONE))

