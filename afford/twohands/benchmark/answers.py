"""Answers of a method on the grid of each case, read from probabilities or from mask files."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from afford.dataset import act_affordance
from afford.twohands.benchmark import predictions_file
from afford.twohands.benchmark.cases import Size, grey, resize_mask
from afford.twohands.benchmark.compat import Grey
from afford.twohands.model.calibration import calibrated
from afford.twohands.model.hand_selection import hand_probabilities
from schemas.benchmark import Case, Prediction
from schemas.files import FileRef, FileTree
from schemas.video import SIDES

ALREADY_CUT = 0.0
"""threshold of masks in a folder without a threshold in its name"""


class Method(Protocol):
    """Stored predictions of one method."""

    levels: tuple[float, ...]

    def answer(self, case: Case) -> Answer:
        """Answer of the method for a case."""


def open_method(files: FileTree, levels: tuple[float, ...], level: float, protocol: str, proposals: int) -> Method:
    """Open the predictions in a folder: a Parquet file of probabilities, or masks in the released layout.

    Probabilities are cut at `levels`, and up to `proposals` proposals are made of them. `level` is the threshold of the strict
    measures for a folder with several thresholds. `protocol` is that of a folder which does not name it.
    """
    table = files.find(predictions_file.FILE_NAME)
    return Probabilities(table, levels, proposals) if table else Masks(files, level, protocol)


class Probabilities:
    """Stored probabilities of a method."""

    def __init__(self, table: FileRef, levels: tuple[float, ...], proposals: int) -> None:
        self.levels, self.proposals = levels, proposals
        self._stored = predictions_file.PredictionFile(table.path)

    def answer(self, case: Case) -> Answer:
        """Answer for a case, empty without a prediction."""
        size = case.modes.shape[2:]
        prediction = self._stored.get(case.case_id)
        if prediction is None:
            return nothing(size, self.levels)
        return of_prediction(prediction, size, self.levels, self.proposals)


class Masks:
    """Mask files of a method, at one or several thresholds.

    ValueError when only some folders name a threshold, or when no threshold is `level`.
    """

    def __init__(self, files: FileTree, level: float, protocol: str) -> None:
        self._files: dict[str, dict[float, dict[str, FileRef]]] = defaultdict(lambda: defaultdict(dict))
        seen = set()
        for threshold, case_id, side, ref in act_affordance.predictions(files, protocol):
            seen.add(threshold)
            self._files[case_id][ALREADY_CUT if threshold is None else threshold][side] = ref
        if None in seen and len(seen) > 1:
            raise ValueError(f"{files.name}: some masks are in a folder of a threshold and some are not; use one form for all")
        self.levels = (ALREADY_CUT,) if seen == {None} else tuple(sorted(at for at in seen if at is not None))
        self._chosen = self.levels[0] if len(self.levels) == 1 else level
        if self._chosen not in self.levels:
            raise ValueError(f"{files.name}: expected a folder of threshold {level}, found {', '.join(map(str, self.levels))}; "
                             f"choose one: --set score_cases.level={self.levels[0]}")

    def answer(self, case: Case) -> Answer:
        """Answer for a case, empty without a prediction."""
        size = case.modes.shape[2:]
        at = self._files.get(case.case_id)
        return nothing(size, self.levels) if at is None else of_files(at, size, self.levels, self._chosen)


CHOICES = np.array([[True, False], [False, True], [True, True]])
"""hands that act: left alone, right alone, both"""
SWAP = (1, 0, 2, 3)
"""order of the taxonomy with the hands exchanged"""


@dataclass(frozen=True)
class Answer:
    """Prediction of a method for one case, at l thresholds with k hypotheses; an axis of 2 is (left, right)."""

    cuts: np.ndarray
    """(l, 2, h, w) bool: the top-ranked region of each returned hand at each threshold"""
    files: tuple[tuple[Grey, Grey], ...]
    """l pairs of grey masks at the method's own size, as the released code reads them from disk"""
    top: np.ndarray
    """(2, h, w) bool: at the method's own threshold"""
    proposals: np.ndarray
    """(k, 2, h, w) bool: its most probable pairs of regions, at its own threshold"""
    unselected: np.ndarray | None = None
    """(2, h, w) bool: `top` without the selection of hands"""
    marginal: np.ndarray | None = None
    """(2, h, w) float32: probability that a pixel is touched by each hand, over hypotheses and selections of hands"""
    taxonomy: np.ndarray | None = None
    """(4,) probabilities"""

    def swapped(self) -> Answer:
        """The answer with left and right exchanged."""
        return replace(
            self,
            cuts=self.cuts[:, ::-1],
            files=tuple((right, left) for left, right in self.files),
            top=self.top[::-1],
            proposals=self.proposals[:, ::-1],
            unselected=None if self.unselected is None else self.unselected[::-1],
            marginal=None if self.marginal is None else self.marginal[::-1],
            taxonomy=None if self.taxonomy is None else self.taxonomy[list(SWAP)],
        )


def nothing(size: Size, levels: tuple[float, ...]) -> Answer:
    """Empty answer: no region, and no file that the released script counts."""
    return Answer(np.zeros((len(levels), 2, *size), bool), ((None, None),) * len(levels), np.zeros((2, *size), bool),
                  np.zeros((1, 2, *size), bool))


def of_prediction(prediction: Prediction, size: Size, levels: tuple[float, ...], proposals: int) -> Answer:
    """Answer of probabilities, resized bilinearly to the grid and cut there, with up to `proposals` proposals.

    `levels` are probabilities of the model itself, as in the released script, so calibration does not move mAP.
    """
    levels = tuple(calibrated(level, prediction.calibration) for level in levels)
    fine = _resize(prediction.probability, size)
    first = [int(rank) for rank in prediction.score.argmax(axis=1)]
    best = np.stack([fine[side, first[side]] for side in range(2)])
    hands = prediction.hands[:, None, None]
    files = tuple(_as_files(prediction, first, level) for level in levels)
    taxonomy = prediction.taxonomy if np.isfinite(prediction.taxonomy).all() else None
    active = prediction.hands if taxonomy is None else hand_probabilities(taxonomy)
    choices = hand_choice_probabilities(prediction.hands, taxonomy)
    return Answer(
        cuts=np.stack([(best > level) & hands for level in levels]),
        files=files,
        top=(best > prediction.threshold) & hands,
        proposals=_proposed(fine > prediction.threshold, prediction.score, choices, proposals),
        unselected=best > prediction.threshold,
        marginal=np.einsum("skhw,sk->shw", fine, prediction.score) * active.astype(np.float32)[:, None, None],
        taxonomy=taxonomy,
    )


def hand_choice_probabilities(hands: np.ndarray, taxonomy: np.ndarray | None) -> np.ndarray:
    """Probabilities of (left alone, right alone, both); without a taxonomy, the returned hands are certain."""
    if taxonomy is not None:
        return np.array([taxonomy[0], taxonomy[1], taxonomy[2:].sum()])
    return np.array([np.array_equal(hands, choice) for choice in CHOICES], float)


def _proposed(regions: np.ndarray, score: np.ndarray, chosen: np.ndarray, count: int) -> np.ndarray:
    """Proposals (n, 2, h, w) bool: the `count` most probable combinations of a choice of hands and a hypothesis, or fewer.

    regions (2, k, h, w) bool, score (2, k), chosen (3,) probabilities of `CHOICES`. A model with one region for each hand also has
    several proposals: its region with every choice of hands.
    """
    joint = np.sqrt(score[0] * score[1])
    rank = np.stack([score[0], score[1], joint / max(joint.sum(), 1e-9)])
    likely = (chosen[:, None] * rank).ravel()
    best = [n for n in np.argsort(-likely, kind="stable")[:count] if likely[n] > 0]
    ways = [regions[:, n % score.shape[1]] & CHOICES[n // score.shape[1], :, None, None] for n in best]
    return np.stack(ways) if ways else np.zeros((1, *regions[:, 0].shape), bool)


def of_files(at: dict[float, dict[str, FileRef]], size: Size, levels: tuple[float, ...], chosen: float) -> Answer:
    """Answer of mask files, threshold -> side -> file; `chosen` is the threshold of the strict measures."""
    found = [{side: grey(ref) for side, ref in at.get(level, {}).items()} for level in levels]
    cuts = np.stack([[_binary(pair.get(side), size) for side in SIDES] for pair in found])
    top = cuts[levels.index(chosen)]
    return Answer(cuts, tuple((pair.get("left"), pair.get("right")) for pair in found), top, top[None])


def _resize(probability: np.ndarray, size: Size) -> np.ndarray:
    """Resize probabilities (2, k, h, w) float32 bilinearly."""
    if probability.shape[2:] == size:
        return probability
    flat = probability.reshape(-1, *probability.shape[2:])
    planes = [cv2.resize(plane, size[::-1], interpolation=cv2.INTER_LINEAR) for plane in flat]
    return np.stack(planes).reshape(*probability.shape[:2], *size)


def _as_files(prediction: Prediction, first: list[int], level: float) -> tuple[Grey, Grey]:
    masks = [np.where(prediction.probability[side, first[side]] > level, np.uint8(255), np.uint8(0)) for side in range(2)]
    left, right = (mask if hand else None for mask, hand in zip(masks, prediction.hands, strict=True))
    return left, right


def _binary(mask: Grey, size: Size) -> np.ndarray:
    return np.zeros(size, bool) if mask is None else resize_mask(mask > 0, size)
