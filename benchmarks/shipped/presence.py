"""Fit the probability that what a task names is in the picture, for the shipped two-hand model; after calibrate.py.

    PYTHONPATH=. python benchmarks/shipped/presence.py [--cases DIR] [--store DIR]

Pictures of kinds and settings that the training does not show, cropped and whole, are asked for their own task and for those of
other pictures; half of the weight goes to their own. What is fitted is how the model answers, mirror image and second look
included. The least probability for a region is as large as it can be while the right words lose `LOSS` of their IoU. The file
(afford/twohands/model/presence.py) and the record are written; the weights and the calibration stay.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

from afford.common.files import tree
from afford.dataset import act_affordance
from afford.models.shipped import FOLDER, TWO_HANDS, file_digest, read_record
from afford.twohands.benchmark.cases import SHIFT, image, prompts, read
from afford.twohands.benchmark.measures import agreement, best_hypothesis_iou
from afford.twohands.model.model_folder import PRESENCE_FILE
from afford.twohands.model.predictor import Predictor
from afford.twohands.model.presence import EDGE, Presence, write_presence
from benchmarks.pages import head
from benchmarks.shipped.calibrate import other_rooms
from benchmarks.shipped.ship import write_record
from schemas.benchmark import Case, Prediction

DRAWS = 2
"""other tasks for each picture"""
LOSS = 0.02
"""share of the IoU with the right words that answers of no region may cost"""
PENALTY = 1e-3
"""on the squares of the weights"""
NEW = "new"
"""group of the kinds that the training does not show"""
CUTS = np.linspace(0, 1, 1001)


@dataclass(frozen=True)
class Recorder(Presence):
    """Stands in for the regression, and keeps what it is given; every answer has regions."""

    given: list[tuple[float, float | None]] = field(default_factory=list)

    def probability(self, expected_iou: float, seen: float | None) -> float:
        """Keep the evidence."""
        self.given.append((expected_iou, seen))
        return 1.0


class Asked(NamedTuple):
    """Answers to n questions."""

    right: np.ndarray
    """(n,) bool: the task is that of the picture"""
    evidence: np.ndarray
    """(n, 3): logit of the expected IoU, 1 for a thing with classes, what the classifier saw of it"""
    iou: np.ndarray
    """(n,) IoU with the best valid way"""


def ask(predictor: Predictor, cases: Sequence[Case]) -> Asked:
    """Ask for right and for other words; the predictor keeps its own regression."""
    own, recorder = predictor.presence, Recorder(0.0, 0.0, 0.0, 0.0, 0.0)
    predictor.presence = recorder
    tasks = [case.task for case in cases]
    words = [tasks, *(prompts(tasks, "shuffled", seed) for seed in range(DRAWS))]
    asked = [(case, task) for some in words for case, task in zip(cases, some, strict=True)]
    found = [best_iou(predictor.predict(image(case), task), case.modes) for case, task in asked]
    predictor.presence = own
    evidence = [(logit(np.clip(expected, EDGE, 1 - EDGE)), seen is not None, seen or 0.0) for expected, seen in recorder.given]
    return Asked(np.arange(len(found)) < len(cases), np.array(evidence, float), np.array(found))


def best_iou(answer: Prediction, modes: np.ndarray) -> float:
    """IoU of an answer with the best of the modes (m, 2, h, w), at their size."""
    size = modes.shape[:1:-1]
    found = [cv2.resize(answer.mask(side).view(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0 for side in range(2)]
    return best_hypothesis_iou(agreement(np.stack(found)[None], modes))


def fit_presence(predictor: Predictor, cases: Sequence[Case]) -> Presence:
    """Fit the regression and the least probability."""
    answers = ask(predictor, cases)
    x = np.column_stack([np.ones(len(answers.right)), answers.evidence])
    weight = np.where(answers.right, 0.5 / answers.right.sum(), 0.5 / (~answers.right).sum())

    def cost(at: np.ndarray) -> tuple[float, np.ndarray]:
        z = x @ at
        loss = weight @ (np.logaddexp(0, z) - answers.right * z) + PENALTY * at @ at
        return float(loss), x.T @ (weight * (expit(z) - answers.right)) + 2 * PENALTY * at

    at = minimize(cost, np.zeros(4), jac=True, method="BFGS").x
    likely, iou_right = expit(x @ at)[answers.right], answers.iou[answers.right]
    kept = [(iou_right * (likely >= cut)).sum() >= (1 - LOSS) * iou_right.sum() for cut in CUTS]
    bias, expected, named, seen = (round(float(value), 4) for value in at)
    return Presence(bias, expected, named, seen, round(float(CUTS[np.flatnonzero(kept).max()]), 3))


def main() -> None:
    """Fit, and write file and record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, help="what `run benchmark-set` wrote; by default it is rendered with another seed")
    parser.add_argument("--store")
    args = parser.parse_args()
    given, folder = args.cases or other_rooms(args.store), FOLDER / TWO_HANDS
    found = [read(files) for files in act_affordance.cases(tree("cases", given))]
    cases = [case for case in found if {SHIFT, NEW} & set(case.groups)]
    if not cases:
        raise SystemExit(f"{given}: expected kinds or settings that the training does not show, found none; render them with "
                         "`run benchmark-set`")
    presence = fit_presence(Predictor(folder), cases)
    print(presence, flush=True)
    write_presence(presence, folder)
    facts = {"presence": {"commit": head(), "cases": file_digest(given / "stills.json")}}
    write_record(folder, read_record(folder) | facts, PRESENCE_FILE)


if __name__ == "__main__":
    main()
