"""Presence: a model whose things are probably not there gives no region, and its probabilities stay as they are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.twohands.benchmark.predictions_file import PredictionFile, write_predictions
from afford.twohands.model.interface import Batch, ModelConfig, build
from afford.twohands.model.model_folder import PRESENCE_FILE
from afford.twohands.model.predictor import NO_REGION, Predictor
from afford.twohands.model.presence import NamedSight, Presence, read_presence, write_presence
from benchmarks.shipped.presence import LOSS, fit_presence
from schemas.benchmark import Case, Prediction
from tests.helpers import tiny_asked
from tests.helpers.command import call

EVEN = Presence(0.0, 0.0, 0.0, 0.0, least=0.6)
"""gives one half to everything, which is too little"""
LITE = ModelConfig(variant="lite", size_px=(64, 96), widths=(16, 24, 32), depth=1, decoder_depth=1, text_buckets=512, classes=True)
RGB = np.random.default_rng(0).integers(0, 255, (60, 90, 3), np.uint8)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return tiny_asked.write_model(tmp_path / "models" / "small" / "model")


def test_a_presence_is_read_as_it_was_written(tmp_path: Path) -> None:
    assert read_presence(tmp_path) is None
    write_presence(Presence(1.0, 2.0, -0.5, 0.25, 0.3), tmp_path)
    assert read_presence(tmp_path) == Presence(1.0, 2.0, -0.5, 0.25, 0.3)


@pytest.mark.parametrize("change", [{"format": "other"}, {"bias": None}, {"seen": float("nan")}, {"least": "much"},
                                    {"named": 1e999}])  # fmt: skip
def test_another_file_is_refused_in_a_sentence(tmp_path: Path, change: dict[str, object]) -> None:
    write_presence(EVEN, tmp_path)
    fields = json.loads((tmp_path / PRESENCE_FILE).read_text())
    for text in (json.dumps({**fields, **change}), json.dumps(list(change)), "{"):
        (tmp_path / PRESENCE_FILE).write_text(text)
        with pytest.raises(ValueError, match=r"presence\.json: expected"):
            read_presence(tmp_path)


def test_more_evidence_is_more_probable() -> None:
    fitted = Presence(-1.0, 1.5, -0.5, 0.25, 0.3)
    by_iou = [fitted.probability(iou, 1.0) for iou in (0.0, 0.1, 0.3, 1.0)]
    by_sight = [fitted.probability(0.2, seen) for seen in (0.0, 1.0, 3.5)]
    for values in (by_iou, by_sight):
        assert values == sorted(values) and len(set(values)) == len(values) and values[0] > 0 and values[-1] < 1
    assert fitted.probability(0.2, None) == fitted.probability(0.2, 2.0)  # -0.5 + 0.25 * 2 = 0
    assert [replace(fitted, bias=bias).probability(0.2, None) for bias in (-1e300, 1e300)] == [0, 1]


def test_no_region_for_what_is_not_there_and_one_with_always(model: Path) -> None:
    before = Predictor(model).predict(RGB, tiny_asked.TASK)
    write_presence(EVEN, model)
    found, always = (Predictor(model, always=one).predict(RGB, tiny_asked.TASK) for one in (False, True))
    assert before.present == 1 and found.present == always.present == 0.5
    assert found.threshold == NO_REGION and not found.mask(0).any() and not found.mask(1).any()
    assert always.threshold == before.threshold and any(before.mask(side).any() for side in range(2))
    for one in (found, always):
        assert np.array_equal(one.probability, before.probability) and np.array_equal(one.hands, before.hands)
    write_presence(replace(EVEN, least=0.5), model)
    assert Predictor(model).predict(RGB, tiny_asked.TASK).threshold == before.threshold


def test_the_verb_says_so(model: Path, tmp_path: Path) -> None:
    write_presence(EVEN, model)
    picture = tiny_asked.write_picture(tmp_path / "kettle.png")
    words = ("predict", picture, tiny_asked.TASK, "--store", model.parents[2], "--json", "--out")
    done = call(*words, tmp_path / "out")
    assert done.code == 0 and "no region in kettle: what the task names is probably not there (50%)" in done.err
    found = json.loads((tmp_path / "out" / "kettle" / "prediction.json").read_text())
    assert found["present"] == 0.5 and found["threshold"] == NO_REGION
    assert found["left"]["area_share"] == found["right"]["area_share"] == 0
    done = call(*words, tmp_path / "all", "--always")
    assert done.code == 0 and "no region" not in done.err
    assert json.loads((tmp_path / "all" / "predictions.json").read_text())["predictions"][0]["region"]


def test_a_classifier_tells_what_it_saw_of_named_things_alone() -> None:
    network = build(LITE, 0).eval()
    sight = NamedSight(network)
    tasks = ["take mug", "take spanner"]
    with torch.inference_mode():
        network(Batch(torch.rand(2, 3, *LITE.size_px, generator=torch.Generator().manual_seed(3)), tuple(tasks)))
    mug, spanner = sight.of(tasks)
    assert mug is not None and 0 <= mug <= 3.6 and spanner is None
    assert NamedSight(build(replace(LITE, classes=False), 0)).of(tasks) == [None, None]


def test_a_file_of_predictions_keeps_it(tmp_path: Path, model: Path) -> None:
    write_presence(EVEN, model)
    write_predictions(tmp_path / "predictions.parquet", [("a", Predictor(model).predict(RGB, tiny_asked.TASK))])
    found = PredictionFile(tmp_path / "predictions.parquet").get("a")
    assert found is not None and found.present == 0.5 and found.threshold == NO_REGION


class Halves:
    """Stands in for a predictor: the left half of a picture for its own task, surely but in every tenth picture, else nothing."""

    presence: Presence | None = None

    def predict(self, rgb: np.ndarray, task: str) -> Prediction:
        number = int(rgb[0, 0, 0])
        own = task == f"take {number}"
        assert self.presence is not None
        present = self.presence.probability(*evidence(number, own))
        region = np.zeros((2, 1, 8, 8), np.float32)
        region[:, :, :, :4] = own
        score, taxonomy = np.ones((2, 1), np.float32), np.full(4, 0.25, np.float32)
        return Prediction(task, region, score, taxonomy, np.ones(2, bool), 0.5, present=present)


def evidence(number: int, own: bool) -> tuple[float, float]:
    """Expected IoU and what a classifier sees."""
    return (0.6 if own and number % 10 else 0.2) + 0.1 * float(np.sin(number)), 3.0 * own


def test_a_fit_separates_right_words_from_others_and_keeps_their_iou(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = np.zeros((1, 2, 8, 8), bool)
    modes[..., :4] = True
    numbers = range(1, 101)
    cases = [replace(blank(), task=f"take {n}", image=np.array([n], np.uint8), modes=modes) for n in numbers]
    monkeypatch.setattr("benchmarks.shipped.presence.image", lambda case: np.full((8, 8, 3), case.image[0], np.uint8))
    predictor = Halves()
    fitted = fit_presence(predictor, cases)  # type: ignore[arg-type]  # a stand-in
    assert predictor.presence is None and fitted.expected_iou > 0 and fitted.seen > 0

    def kept(least: float, own: bool) -> float:
        return float(np.mean([fitted.probability(*evidence(n, own)) >= least for n in numbers]))

    assert kept(fitted.least, own=True) >= 1 - LOSS > kept(fitted.least + 0.01, own=True)
    assert kept(fitted.least, own=False) < 0.1


def blank() -> Case:
    return Case("cropped", "v", "1", ("all", "new"), "", "", "", np.zeros(1, np.uint8), np.zeros((1, 2, 8, 8), bool),
                np.zeros(1, np.int8), np.zeros((2, 8, 8), bool), ())  # fmt: skip
