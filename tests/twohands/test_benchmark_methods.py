"""Predictions of methods (masks in the released layout, stored probabilities, baselines) and their scores."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.common.files import tree
from afford.dataset import act_affordance
from afford.twohands.benchmark import answers, dataset_baselines, predictions_file
from afford.twohands.benchmark import cases as cases_module
from afford.twohands.benchmark.answers import nothing, of_prediction
from afford.twohands.benchmark.score import MEASURES
from schemas.benchmark import MethodScores, Prediction
from schemas.files import FileTree
from stages.extraction import dataset_pack
from stages.twohands import baseline_cases, benchmark, score_cases
from tests.helpers.made_cases import SIZE, as_tree, box, read_all, write_benchmark, write_case, write_mask
from tests.helpers.made_samples import Scratch, clip

LEFT, RIGHT = box(10, 10, 30, 30), box(50, 20, 70, 40)
NONE = FileTree("none", ())


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return as_tree(write_benchmark(tmp_path_factory.mktemp("made") / "bench"))


def value(scores: MethodScores, case: str, measure: str) -> float:
    return float(scores.values[scores.case_id.index(case), MEASURES.index(measure)])


def truth_as_predictions(root: Path, threshold: str = "") -> Path:
    """The true masks of the first mode, in the released layout."""
    cases = read_all(write_benchmark(root / "again"))
    for case in (case for case in cases.values() if case.protocol == "cropped"):
        for side, mask in zip(("left", "right"), case.modes[0], strict=True):
            if mask.any():
                write_mask(root / "masks" / threshold / case.video / case.frame / f"aff_{side}.png", mask)
    return root / "masks"


def test_the_truth_as_a_folder_scores_one(bench: FileTree, tmp_path: Path) -> None:
    """Cropped cases: strict and compat IoU 1; whole images have no prediction: strict 0, compat skips them."""
    scores = score_cases.run(bench, as_tree(truth_as_predictions(tmp_path)), score_cases.Params())
    cropped = np.array([protocol == "cropped" for protocol in scores.protocol])
    iou, answered = (scores.values[:, MEASURES.index(name)] for name in ("iou", "answered"))
    assert (iou[cropped] == 1).all() and (iou[~cropped] == 0).all() and answered.tolist() == cropped.astype(float).tolist()
    assert (scores.compat[cropped, 0, :2] == 1).all() and np.isnan(scores.compat[~cropped]).all()
    assert scores.name == "masks" and scores.level == (0.0,)


def test_swapped_hands_keep_the_union_and_lose_the_hands(bench: FileTree, tmp_path: Path) -> None:
    """IoU of the union stays 1, that of each hand falls to 0."""
    predicted = as_tree(truth_as_predictions(tmp_path))
    scores = score_cases.run(bench, predicted, score_cases.Params(swap=True))
    case = "cropped/P01_01/0000140"
    assert (value(scores, case, "iou"), value(scores, case, "hand_iou"), value(scores, case, "hands_accuracy")) == (1, 0, 1)
    assert value(scores, "cropped/P01_01/0000150", "hands_accuracy") == 0 and scores.name == "masks_swapped"


def test_threshold_folders_give_map_and_the_best_is_reported(bench: FileTree, tmp_path: Path) -> None:
    """Double the area at 0.1 (precision 0.5) and the truth at 0.5 give mAP 0.75; the default level is 0.5."""
    name, predicted = "P01_01/0000150", tmp_path / "masks"
    write_mask(predicted / "out0.1" / name / "aff_right.png", box(30, 20, 70, 40))
    write_mask(predicted / "out0.5" / name / "aff_right.png", RIGHT)
    scores = score_cases.run(bench, as_tree(predicted), score_cases.Params())
    case = f"cropped/{name}"
    assert scores.level == (0.1, 0.5) and (value(scores, case, "iou"), value(scores, case, "map")) == (1, 0.75)
    assert scores.compat[scores.case_id.index(case), :, 1].tolist() == [0.5, 1]
    assert value(score_cases.run(bench, as_tree(predicted), score_cases.Params(level=0.1)), case, "iou") == 0.5
    with pytest.raises(ValueError, match=r"expected a folder of threshold 0.3, found 0.1, 0.5"):
        score_cases.run(bench, as_tree(predicted), score_cases.Params(level=0.3))


def test_folders_of_predictions_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    """No masks, a folder name without a threshold, and thresholds in some folders only."""
    with pytest.raises(SourceError, match=r"aff_left.png or aff_right.png, got none"):
        answers.Masks(as_tree(tmp_path), 0.5, "cropped")
    write_mask(tmp_path / "a" / "v" / "1" / "aff_left.png", LEFT)
    with pytest.raises(SourceError, match="end in its number"):
        answers.Masks(as_tree(tmp_path), 0.5, "cropped")
    mixed = tmp_path / "mixed"
    write_mask(mixed / "v" / "1" / "aff_left.png", LEFT)
    write_mask(mixed / "0.5" / "v" / "1" / "aff_left.png", LEFT)
    with pytest.raises(ValueError, match="use one form for all"):
        answers.Masks(as_tree(mixed), 0.5, "cropped")


def made_prediction() -> Prediction:
    """Two hypotheses; the right hand's second one ranks first; the left hand is not returned."""
    planes = np.zeros((2, 2, *SIZE), np.float32)
    planes[0, 0][LEFT], planes[1, 0][LEFT], planes[1, 1][RIGHT] = 0.9, 0.6, 0.4
    return Prediction("take mug", planes, np.array([[0.8, 0.2], [0.3, 0.7]], np.float32),
                      np.array([0.1, 0.7, 0.1, 0.1], np.float32), np.array([False, True]), 0.35)


def test_probabilities_are_ranked_cut_and_selected() -> None:
    """The first-ranked region above the threshold, of returned hands only; the choice of hands can be looked behind."""
    predicted = of_prediction(made_prediction(), SIZE, (0.3, 0.5), 3)
    assert not predicted.top[0].any() and np.array_equal(predicted.top[1], RIGHT)
    assert np.array_equal(predicted.cuts[0, 1], RIGHT) and not predicted.cuts[1].any()
    assert predicted.unselected is not None and np.array_equal(predicted.unselected[0], LEFT)
    assert predicted.files[0][0] is None and predicted.files[0][1] is not None and set(np.unique(predicted.files[0][1])) == {0, 255}


def test_proposals_are_the_most_probable_ways() -> None:
    """Right alone 0.7 times 0.7 and 0.3, then both (0.2 times its joint rank); a model of one region differs in hands alone."""
    found = of_prediction(made_prediction(), SIZE, (0.5,), 3).proposals
    assert [list(way.any((1, 2))) for way in found] == [[False, True], [False, True], [True, True]]
    assert np.array_equal(found[0, 1], RIGHT) and np.array_equal(found[1, 1], LEFT) and np.array_equal(found[2, 0], LEFT)
    fixed = made_prediction()
    one = replace(fixed, probability=fixed.probability[:, :1], score=np.ones((2, 1), np.float32))
    assert [list(way.any((1, 2))) for way in of_prediction(one, SIZE, (0.5,), 3).proposals] == [
        [False, True], [True, True], [True, False]]  # fmt: skip
    sure = replace(one, taxonomy=np.full(4, np.nan, np.float32))
    assert len(of_prediction(sure, SIZE, (0.5,), 3).proposals) == 1


def test_the_marginal_joins_hypotheses_and_hands() -> None:
    """Left: 0.8 of 0.9, times P(left) = 1 - 0.7; right: 0.7 of 0.4, times P(right) = 1 - 0.1."""
    found = of_prediction(made_prediction(), SIZE, (0.5,), 3)
    assert found.marginal is not None
    assert found.marginal[0, 15, 15] == pytest.approx(0.8 * 0.9 * 0.3)
    assert found.marginal[1, 30, 60] == pytest.approx(0.7 * 0.4 * 0.9)


def test_stored_predictions_come_back(tmp_path: Path) -> None:
    """Probabilities come back to 1/255, other cases have no prediction, and equal predictions give equal bytes."""
    found = made_prediction()
    for name in ("a", "b"):
        predictions_file.write_predictions(tmp_path / name, [("cropped/v/1", found), ("cropped/v/2", found)])
    back = predictions_file.PredictionFile(tmp_path / "a").get("cropped/v/2")
    assert back is not None and np.abs(back.probability - found.probability).max() <= 0.5 / 255 + 1e-6
    assert np.array_equal(back.score, found.score) and np.array_equal(back.hands, found.hands) and back.threshold == found.threshold
    assert predictions_file.PredictionFile(tmp_path / "a").get("cropped/v/3") is None
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_silence_is_no_file_and_no_region() -> None:
    """Strict scores it 0, compat does not count it."""
    predicted = nothing(SIZE, (0.1, 0.5))
    assert not predicted.cuts.any() and predicted.files == ((None, None), (None, None))


def test_whole_object_by_hand(bench: FileTree, tmp_path: Path) -> None:
    """20 x 20 px inside the complete object; the hand that rests gets a mask too many; Ego4D has no object: no prediction."""
    predicted = baseline_cases.run(bench, NONE, baseline_cases.Params(), Scratch(tmp_path))
    scores = score_cases.run(bench, predicted, score_cases.Params())
    union = box(5, 5, 40, 40) | box(40, 10, 78, 50)
    case = "cropped/P01_01/0000140"
    assert value(scores, case, "precision") == pytest.approx(800 / union.sum()) and value(scores, case, "recall") == 1
    assert value(scores, case, "left.iou") == pytest.approx(400 / 35**2)
    assert (value(scores, "cropped/P01_01/0000150", "spurious"), value(scores, case, "missed")) == (1, 0)
    assert np.isnan(value(scores, case, "spurious")) and np.isnan(value(scores, case, "taxonomy_accuracy"))
    assert value(scores, "cropped/11286c45-7869/00000335", "answered") == 0


def test_modes_count_for_the_best(bench: FileTree, tmp_path: Path) -> None:
    """The left way of a task whose first way is the right: IoU 1, first-mode IoU 0; best-mode IoU is over all three."""
    write_mask(tmp_path / "masks" / "P95_01" / "0000001" / "aff_left.png", LEFT)
    scores = score_cases.run(bench, as_tree(tmp_path / "masks"), score_cases.Params())
    case = "cropped/P95_01/0000001"
    assert (value(scores, case, "iou"), value(scores, case, "first_mode_iou"), value(scores, case, "hands_accuracy")) == (1, 0, 1)
    assert value(scores, case, "best_mode_iou") == pytest.approx((0 + 1 + 0.5) / 3)


def test_taxonomy_is_open_where_the_words_do_not_tell(bench: FileTree, tmp_path: Path) -> None:
    """`take mug` is done with the right hand in one picture and with the left in another; `open jar` is always the same."""
    fixed = Prediction("", np.zeros((2, 1, *SIZE), np.float32), np.ones((2, 1), np.float32),
                      np.array([0.1, 0.7, 0.1, 0.1], np.float32), np.array([False, True]), 0.5)
    rows = [(files.where, fixed) for files in act_affordance.cases(bench)]
    predictions_file.write_predictions(tmp_path / predictions_file.FILE_NAME, rows)
    scores = score_cases.run(bench, tree("fixed", tmp_path), score_cases.Params())
    assert value(scores, "cropped/P01_01/0000150", "taxonomy_open_accuracy") == 1
    assert value(scores, "cropped/P02_03/0000007", "taxonomy_open_accuracy") == 0
    assert np.isnan(value(scores, "cropped/P01_01/0000140", "taxonomy_open_accuracy"))
    assert value(scores, "cropped/P95_01/0000001", "taxonomy_accuracy") == 1
    report = benchmark.run((scores,), (), benchmark.Params(resamples=20), Scratch(tmp_path / "r"))
    assert "### Taxonomy, fixed, cropped" in report.find("report.md").path.read_text()


def test_prompts_are_shuffled_or_removed() -> None:
    """No case keeps its own task; shuffling is seeded; a single wording cannot be shuffled."""
    given = ["take mug", "open jar", "take mug", "cut bread"]
    fixed = cases_module.prompts(given, "shuffled", 0)
    assert all(a != b for a, b in zip(given, fixed, strict=True)) and fixed == cases_module.prompts(given, "shuffled", 0)
    assert cases_module.prompts(given, "removed", 0) == [""] * 4 and cases_module.prompts(given, "given", 0) == given
    with pytest.raises(ValueError, match="at least two different tasks"):
        cases_module.prompts(["take mug"] * 3, "shuffled", 0)


def packed(folder: Path) -> FileTree:
    made = tuple(clip(f"P{n:02d}_01", 9, split=("train", "val")[n]) for n in range(2))
    return dataset_pack.run(made, dataset_pack.Params(), Scratch(folder))


def test_class_mean_learns_where_hands_go(bench: FileTree, tmp_path: Path) -> None:
    """A mean has the mean area at 0.5 and the class's usual hands; without a data set it is refused."""
    predicted = baseline_cases.run(bench, packed(tmp_path / "data"), baseline_cases.Params("class_mean"), Scratch(tmp_path / "out"))
    found = predictions_file.PredictionFile(predicted.files[0].path).get("cropped/P01_01/0000140")
    assert found is not None and np.isfinite(found.taxonomy).all() and found.taxonomy.sum() == pytest.approx(1)
    assert (found.probability[found.hands] > 0.5).any()
    with pytest.raises(ValueError, match="class_mean: expected a data set"):
        dataset_baselines.class_mean(None)


def test_the_extraction_answers_for_its_own_frames(tmp_path: Path) -> None:
    """Found by video and frame number, padded above to a square; crops and other frames get no answer."""
    data = packed(tmp_path / "data")
    write_case(tmp_path / "b", "masks/P00_01/0000001", "open jar", "left", {"aff_left": box(0, 90, 9, 96, (96, 96))})
    write_case(tmp_path / "b", "masks/P77_01/0000001", "open jar", "left", {"aff_left": box(0, 90, 9, 96, (96, 96))})
    predicted = baseline_cases.run(as_tree(tmp_path / "b"), data, baseline_cases.Params("extraction"), Scratch(tmp_path / "out"))
    table = predictions_file.PredictionFile(predicted.files[0].path)
    found = table.get("masks/P00_01/0000001")
    truth = clip("P00_01", 9, split="train").samples[0].masks[:2]
    assert found is not None and table.get("masks/P77_01/0000001") is None
    assert np.array_equal(found.probability[:, 0, 32:] > 0.5, truth) and not found.probability[:, 0, :32].any()
    assert np.array_equal(dataset_baselines.to_case_grid(truth[0], (64, 96)), truth[0])


def test_methods_of_one_name_or_of_other_cases_cannot_be_compared(bench: FileTree, tmp_path: Path) -> None:
    """The message says which."""
    predicted = baseline_cases.run(bench, NONE, baseline_cases.Params("centre"), Scratch(tmp_path / "a"))
    scores = score_cases.run(bench, predicted, score_cases.Params())
    with pytest.raises(ValueError, match="two methods are called centre"):
        benchmark.run((scores,), (scores,), benchmark.Params(), Scratch(tmp_path / "b"))
    write_case(tmp_path / "other", "cropped/P01_01/0000001", "take mug", "left", {"aff_left": LEFT})
    other = as_tree(tmp_path / "other")
    alone = baseline_cases.run(other, NONE, baseline_cases.Params("object_box"), Scratch(tmp_path / "c"))
    elsewhere = score_cases.run(other, alone, score_cases.Params())
    with pytest.raises(ValueError, match="score both on the same benchmark"):
        benchmark.run((scores,), (elsewhere,), benchmark.Params(), Scratch(tmp_path / "d"))
