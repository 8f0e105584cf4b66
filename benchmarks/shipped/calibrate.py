"""Calibrate the shipped two-hand model on rooms of settings that its training does not show; its weights stay.

    PYTHONPATH=. python benchmarks/shipped/calibrate.py [--cases DIR] [--store DIR]

A model is much surer of what is new to it than it is right, and what users show it is new to it. Slope and offset of its logits
are fitted to its own answers (mirror image and second look included) to the crops of the rows `workshop` and `desk`; its config,
card and record are written again. The weight of the classifier in a prediction is set before (`TRUST`).
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from afford.common.files import tree
from afford.dataset import act_affordance
from afford.models.shipped import CARD, FOLDER, TWO_HANDS, file_digest, read_record
from afford.twohands.benchmark.cases import SHIFT, image, read
from afford.twohands.model.calibration import calibrated, fit_calibration
from afford.twohands.model.hand_selection import hand_probabilities
from afford.twohands.model.model_folder import config_json
from afford.twohands.model.predictor import Predictor
from benchmarks.pages import head, make
from benchmarks.shipped.ship import write_record
from schemas.benchmark import Case

SEED = 20263
"""of rooms and objects that are not those of the benchmark"""
TRUST = 2.5
"""`ModelConfig.trust` of the shipped model: more than in training, since users bring photographs, which a classifier knows best"""
PASSES = 3
"""fits, one after the other: the mean over a picture and its mirror image is not linear in slope and offset"""
Region = tuple[np.ndarray, np.ndarray, float]
"""probabilities, truth, and probability of the hand, for `fit_calibration`"""


def other_rooms(store: str | None) -> Path:
    """Render the benchmark's pictures with another seed."""
    return Path(make("benchmark-set", store, "--set", f"benchmark_plan.seed={SEED}")["outputs"]["benchmark"])


def unfamiliar(folder: Path) -> list[Case]:
    """Crops of the settings that training does not show."""
    found = (read(files) for files in act_affordance.cases(tree("cases", folder)) if files.protocol == "cropped")
    return [case for case in found if SHIFT in case.groups]


def regions(predictor: Predictor, cases: list[Case]) -> Iterator[Region]:
    """Yield what the predictor answers for each hand, beside the truth of every mode."""
    for case in cases:
        answer = predictor.predict(image(case), case.task)
        hands = hand_probabilities(answer.taxonomy)
        for side in range(2):
            likely = cv2.resize(answer.probability[side, answer.score[side].argmax()], case.modes.shape[:1:-1])
            yield from ((likely.ravel(), mode[side].ravel(), float(hands[side])) for mode in case.modes)


def main() -> None:
    """Fit, and write config, card and record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, help="what `run benchmark-set` wrote; by default it is rendered with another seed")
    parser.add_argument("--store")
    args = parser.parse_args()
    given = args.cases or other_rooms(args.store)
    folder, cases = FOLDER / TWO_HANDS, unfamiliar(given)
    if not cases:
        raise SystemExit(f"{given}: expected crops of workshops or desks, found none; render them with `run benchmark-set`")
    predictor = Predictor(folder)
    predictor.model.config = config = replace(predictor.model.config, trust=TRUST)
    for _ in range(PASSES):
        slope, offset = fit_calibration(regions(predictor, cases))
        before = config.calibration
        at = round(slope * before[0], 4), round(slope * before[1] + offset, 4)
        config = replace(config, calibration=at, threshold=round(calibrated(config.threshold, (slope, offset)), 4))
        predictor.model.config = config
        print(f"calibration {at}, threshold {config.threshold}", flush=True)
    write_card(folder / CARD, f"Then slope and offset, {config.calibration}, were fitted again to {len(cases)} crops of workshops "
               f"and desks, which the training does not show, by benchmarks/shipped/calibrate.py at commit `{head()}`, with "
               f"{TRUST} as the weight of the classifier; the threshold, now {config.threshold}, moved along. Each picture has "
               "its own, by its probabilities.")  # fmt: skip
    (folder / "config.json").write_text(config_json(config), encoding="utf-8")
    facts = {"calibrated": {"commit": head(), "cases": file_digest(given / "stills.json")}}
    write_record(folder, read_record(folder) | facts, "config.json", CARD)


def write_card(card: Path, line: str) -> None:
    """Write a sentence behind that about the threshold of the training, in place of an earlier one. SystemExit without it."""
    text, count = re.subn(r"(and the threshold [0-9.]+ was chosen\.)[^\n]*", rf"\1 {line}", card.read_text(encoding="utf-8"))
    if count != 1:
        raise SystemExit(f"{card}: expected one sentence about the threshold that the training chose, found {count}")
    card.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
