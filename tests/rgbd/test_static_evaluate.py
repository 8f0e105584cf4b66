"""Static evaluation: figures by hand, sets that lack classes, both kinds of pictures, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.files import tree
from afford.rgbd.evaluate.static_sets import ScoredPicture, SetScores
from afford.rgbd.model.predictor import PicturePrediction, Predictor, last_picture
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, StaticSample, StaticSet
from stages.rgbd import static_evaluate, static_read
from tests.helpers.made_interactions import iit_aff, umd
from tests.helpers.made_samples import Scratch
from tests.helpers.made_sequences import SIZE, interaction
from tests.helpers.tiny_sor3d import last_frame, write_model

GRASP, CUT, LIFT = (AFFORDANCES.index(name) for name in ("grasp", "cut", "lift"))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    root = tmp_path_factory.mktemp("trained")
    write_model(root / "model")
    return tree("sor3d", root)


def sample(label: np.ndarray) -> StaticSample:
    rgb, depth_m = np.zeros((*label.shape, 3), np.uint8), np.zeros((0, *label.shape), np.float32)
    return StaticSample("one", "umd", "test", "knife", rgb, depth_m, label, np.zeros((0, 3, 3)))


def told(*planes: tuple[int, np.ndarray]) -> PicturePrediction:
    """Probability 0.6 of a class where its mask says so, 0.3 of background everywhere."""
    probability = np.zeros((10, *planes[0][1].shape), np.float32)
    probability[BACKGROUND] = 0.3
    for kind, mask in planes:
        probability[kind][mask] = 0.6
    return PicturePrediction(probability, np.zeros((0, 0), np.float32), np.zeros((0, 4), np.float32))


def test_figures_by_hand() -> None:
    """8 true pixels of grasp: 4 are found and 4 predicted as lift, which the set lacks; cut is found with 4 pixels too many."""
    label = np.full((4, 4), BACKGROUND, np.uint8)
    label[:2], label[2, :2] = GRASP, CUT
    mask = np.zeros((3, 4, 4), bool)
    mask[0, 0], mask[1, 1], mask[2, 2], mask[2, 3, :2] = True, True, True, True
    tally = SetScores.of([sample(label)])
    tally.add(ScoredPicture(sample(label), told((GRASP, mask[0]), (LIFT, mask[1]), (CUT, mask[2]))))
    found = tally.metrics()
    assert found["iou.grasp"] == pytest.approx(4 / 8) and found["f.grasp"] == pytest.approx(8 / 12, abs=1e-6)
    assert found["iou.cut"] == pytest.approx(2 / 6, abs=1e-6) and "iou.lift" not in found
    assert found["iou"] == pytest.approx((4 / 8 + 2 / 6) / 2, abs=1e-6)
    assert found["fw"] == pytest.approx((0.2 * 8 / 12 + 0.083 * 4 / 8) / 0.283, abs=1e-5)


def test_closed_to_the_classes_of_the_set() -> None:
    """The most likely class of the set replaces lift, which the set lacks."""
    label = np.full((4, 4), GRASP, np.uint8)
    whole = np.ones((4, 4), bool)
    said = told((LIFT, whole))
    said.probability[GRASP] = 0.4
    tally = SetScores.of([sample(label)])
    tally.add(ScoredPicture(sample(label), said))
    assert tally.metrics()["iou"] == 0 and tally.metrics()["closed.iou"] == 1


def test_a_perfect_answer_scores_one() -> None:
    """Figures are one, whatever the classes."""
    label = np.random.default_rng(0).integers(0, 10, (6, 6)).astype(np.uint8)
    tally = SetScores.of([sample(label)])
    tally.add(ScoredPicture(sample(label), told(*((kind, label == kind) for kind in range(10)))))
    assert {tally.metrics()[name] for name in ("iou", "f", "fw", "closed.iou")} == {1.0}


@pytest.mark.parametrize("source", ["umd", "iit-aff"])
def test_sets_as_they_are_read(source: str, model: FileTree, tmp_path: Path) -> None:
    """Three files for sets with and without depth, wide or not; the report names the classes of the set only."""
    files = umd(tmp_path / "set") if source == "umd" else iit_aff(tmp_path / "set")
    samples = static_read.run(files, static_read.Params(source, crop_px=0))
    found = static_evaluate.run(samples, model, static_evaluate.Params(name=source), Scratch(tmp_path / "scratch"))
    assert [file.name for file in found.files] == ["metrics.json", "report.md", "sheet.png"]
    metrics = json.loads(found.find("metrics.json").path.read_text())
    assert {name.partition(".")[2] for name in metrics if name.startswith("f.")} == {"grasp", "cut", "hammer"}
    assert all(0 <= value <= 1 for value in metrics.values())
    assert cv2.imread(str(found.find("sheet.png").path)).shape[0] > 2 * 190
    assert "| hammer |" in found.find("report.md").path.read_text()


def test_the_last_frame_of_a_sequence_is_its_picture(model: FileTree, tmp_path: Path) -> None:
    """The figures are those of the predictor in static mode."""
    clips = [interaction(n, "val")[0] for n in range(3)]
    found = static_evaluate.run(tuple(clips), model, static_evaluate.Params(split="val"), Scratch(tmp_path))
    predictor = Predictor(next(file.path.parent for file in model.files if file.name.endswith("config.json")))
    tally = SetScores.of([last_picture(clip) for clip in clips])
    for clip in clips:
        said = predictor.predict(last_frame(predictor.inputs_of_clip(clip, None)))
        assert said.label.shape == (SIZE, SIZE)
        prediction = PicturePrediction(said.probability, said.attention, np.zeros((0, 4), np.float32))
        tally.add(ScoredPicture(last_picture(clip), prediction))
    assert json.loads(found.find("metrics.json").path.read_text()) == tally.metrics()


def test_sets_that_cannot_be_scored_are_refused(model: FileTree, tmp_path: Path) -> None:
    """One sentence each."""
    nothing = sample(np.full((40, 40), BACKGROUND, np.uint8))
    usual = static_evaluate.Params()
    for params, hint in ((replace(usual, split="val"), "pictures of the split 'val'"),
                         (usual, "umd: none of 1 pictures has an affordance"), (replace(usual, backend="other"), "choose one of")):
        with pytest.raises((ValueError, KeyError), match=hint):
            static_evaluate.run(StaticSet((nothing,), ()), model, params, Scratch(tmp_path))


def test_pictures_that_could_not_be_read_are_named(model: FileTree, tmp_path: Path) -> None:
    """The report lists them next to the figures of the others, which are unchanged."""
    samples = static_read.run(umd(tmp_path / "set"), static_read.Params("umd", crop_px=0))
    reports = []
    for n, refused in enumerate(((), ("b.jpg: expected a picture", "c.jpg: expected a label"))):
        found = static_evaluate.run(replace(samples, refused=refused), model, static_evaluate.Params(), Scratch(tmp_path / str(n)))
        reports.append([found.find(name).path.read_text() for name in ("metrics.json", "report.md")])
    (clean, short), (same, told) = reports
    assert same == clean and told == f"{short}\nNot scored, as they could not be read: 2.\n\n- b.jpg: expected a picture\n" \
        "- c.jpg: expected a label\n"
