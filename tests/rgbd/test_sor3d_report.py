"""The report of SOR3D-AFF's model and of its ablation: figures by hand, what is not finished is marked, strangers are refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.rgbd.evaluate import ablation_rows, report
from afford.rgbd.evaluate.ablation_rows import ALL, PRETRAINED, WHOLE, recipes, row_label
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, FlowScore, InteractionScores, ShownAnswer
from stages.rgbd import sor3d_report
from tests.helpers.made_samples import Scratch

GRASP, PUSH = AFFORDANCES.index("grasp"), AFFORDANCES.index("push")


def scores(name: str, hit: int = 50, mode: tuple[str, ...] = ("video", "static")) -> InteractionScores:
    """Make the scores of two sequences, of grasp and of push, with 100 true pixels each.

    `hit` of 100 found are right in videos, half as many in pictures, and twice as many without regard to the class. The
    action of the first sequence is right.
    """
    pixels = np.zeros((2, len(mode), 3, 9), np.int64)
    for n, kind in enumerate((GRASP, PUSH)):
        for m in range(len(mode)):
            pixels[n, m, :, kind] = (hit // (m + 1), 100, 100)
    action = np.zeros((2, len(mode), 9), np.float32)
    action[:, :, GRASP] = 1
    row_label = np.full((8, 8), BACKGROUND, np.uint8)
    row_label[:4] = GRASP
    shown = ShownAnswer("a", np.full((8, 8, 3), 90, np.uint8), row_label, np.stack([row_label, row_label[::-1]]),
                        np.stack([np.full((8, 8), 0.9), np.full((8, 8), 0.5)]).astype(np.float16),
                        np.ones((2, 2, 2), np.float32))  # fmt: skip
    region = np.array([[min(2 * hit // (m + 1), 100) for m in range(len(mode))]] * 2, np.int64)
    code = np.array([[[0.9, 0.2 * m] for m in range(len(mode))], [[0.7, 0.4] for _ in mode]])
    return InteractionScores(name, mode, ("a", "b"), ("can", "can"), ("grasp", "push"), pixels, region, code, action, (shown,))


def read(found: FileTree, name: str) -> str:
    """A file of a report."""
    return found.find(name).path.read_text()


def test_one_model_by_hand(tmp_path: Path) -> None:
    """IoU, F and weighted F from counts; the action; intervals; motion pooled over sequences; the paper beside it."""
    flows = (FlowScore("a", 100, 10, 1.0, 0.5, 2.0, 1.0, 300.0, 25.0, 600.0, 40.0),
             FlowScore("b", 300, 0, 0.0, 0.0, 2.0, 0.0, 100.0, 0.0, 200.0, 0.0))  # fmt: skip
    planned = recipes((WHOLE,), (0,))
    found = sor3d_report.run(planned, (scores(planned[0].name),), sor3d_report.Params(), Scratch(tmp_path), flows=flows)
    numbers = json.loads(read(found, "metrics.json"))
    assert numbers["video.iou"] == pytest.approx(50 / 150) and numbers["static.iou"] == pytest.approx(25 / 175)
    assert numbers["video.f"] == numbers["video.fw"] == pytest.approx(0.5) and numbers["video.iou.push"] == pytest.approx(1 / 3)
    assert (numbers["action.accuracy"], numbers["action.accuracy.grasp"], numbers["action.accuracy.push"]) == (0.5, 1.0, 0.0)
    assert numbers["video.region_iou"] == pytest.approx(1.0) and numbers["static.region_iou"] == pytest.approx(50 / 150)
    assert (numbers["video.code_jaccard"], numbers["static.code_f1"]) == pytest.approx((0.8, 0.3))
    assert (numbers["flow.epe_ratio"], numbers["flow.epe_ratio_moving"]) == (0.25, 0.5)
    assert numbers["flow.epe_mm"] == pytest.approx(2.5)
    assert (numbers["flow.epe_px"], numbers["flow.difference_epe_px_moving"]) == (1.0, 4.0)
    assert numbers["video.iou.low"] == numbers["video.iou.high"] == pytest.approx(numbers["video.iou"])
    text = read(found, "report.md")
    assert "0.333 (0.33 to 0.33) | 0.500 (0.50 to 0.50) | 0.500 (0.50 to 0.50) | 1.000 | 0.72 | 0.80 | 0.81 |" in text
    assert "AffordanceNet" in text and "0.25 of that of optical flow" in text
    assert "On the image: 1.00 px, optical flow alone 2.00 px; over pixels that move 2.50 px, 4.00 px." in text
    assert "| push | 0.333 | 0.500 | 0.143 | 0.250 | 0.000 |" in text


def test_unfinished_rows_are_marked(tmp_path: Path) -> None:
    """Lines of the paper: means and spreads over seeds, one seed of two, none of two, not requested."""
    planned = recipes(("rgb", "rgb_attention", "rgbd", PRETRAINED), (0, 1))
    done = (scores("rgb-0", 40), scores("rgb-1", 60), scores("rgb_attention-0", 70))
    found = sor3d_report.run(planned, done, sor3d_report.Params(ablation=True), Scratch(tmp_path))
    numbers = json.loads(read(found, "metrics.json"))
    values = [40 / 160, 60 / 140]
    assert numbers["rgb.video.iou"] == pytest.approx(np.mean(values))
    assert numbers["rgb.video.iou.sd"] == pytest.approx(np.std(values, ddof=1))
    assert [numbers[f"{row}.unfinished"] for row in ("rgb", "rgb_attention", "rgbd", PRETRAINED)] == [0, 1, 2, 2]
    table = [line for line in read(found, "report.md").splitlines() if line.startswith("| ")]
    lines = {line.split(" | ")[0].removeprefix("| "): line for line in table}
    assert lines.keys() >= set(ALL) and "| 2 | 0.62 | 0.73 |" in lines["rgb"]
    assert "1 of 2, not finished" in lines["rgb_attention"] and "0 of 2, not finished" in lines["rgbd"]
    assert "not trained" in lines["rgbd_attention"] and lines[PRETRAINED].endswith("|  |  |")
    where = 1 - np.mean([80 / 120, 1])
    assert lines["attention"] == f"| attention | {70 / 130 - np.mean(values):+.3f} | {where:+.3f} | +0.000 | +0.03 |"
    assert "depth" not in lines
    assert json.loads(read(found, "scores.json")).keys() == {"rgb-0", "rgb-1", "rgb_attention-0"}


def test_gain_of_each_part_needs_both_rows() -> None:
    """Video over pictures and pre-training, which the paper does not report, are included."""
    seeds = [{"video.iou": 0.7, "static.iou": 0.5, "action.accuracy": 0.9, "static.action": 0.3}]
    text = report.steps_table({WHOLE: seeds, PRETRAINED: [{"video.iou": 0.75, "action.accuracy": 0.8}], "rgb": []})
    assert "| learning actions before | +0.050 |  | -0.100 |  |" in text and "| video | +0.200 |  | +0.600 | +0.18 |" in text
    assert "attention" not in text and not report.steps_table({})


def test_second_group_is_in_the_report(tmp_path: Path) -> None:
    """Scores of pretrained rows are a separate input."""
    planned = recipes((WHOLE, PRETRAINED), (0,))
    found = sor3d_report.run(planned, (scores(planned[0].name),), sor3d_report.Params(ablation=True), Scratch(tmp_path),
                             (scores(planned[1].name, 60),))  # fmt: skip
    numbers = json.loads(read(found, "metrics.json"))
    assert numbers["pretrained.video.f"] == pytest.approx(0.6) and "flow.epe_ratio" not in numbers


def test_sheet_shows_confident_pixels_only(tmp_path: Path) -> None:
    """Green where the video is confident; the picture's answer, at 0.5, leaves the frame grey."""
    planned = recipes((WHOLE,), (0,))
    found = sor3d_report.run(planned, (scores(planned[0].name),), sor3d_report.Params(), Scratch(tmp_path))
    sheet = cv2.imread(str(found.find("sheet.png").path))
    green = (sheet[..., 1].astype(int) - sheet[..., 0] > 100) & (sheet[..., 1].astype(int) - sheet[..., 2] > 100)
    columns = np.array_split(green[:, : sheet.shape[1] // 2], 5, axis=1)
    assert [bool(column[30:-30].any()) for column in columns[:4]] == [False, True, True, False]


def test_unplanned_or_missing_scores_are_refused(tmp_path: Path) -> None:
    """Scores of another plan, and no score at all, are errors."""
    for done in ((), (scores("other-0"),)):
        with pytest.raises(ValueError, match="expected scores of rgb-0"):
            sor3d_report.run(recipes(("rgb",), (0,)), done, sor3d_report.Params(), Scratch(tmp_path))


def test_report_without_finished_rows_shows_the_plan(tmp_path: Path) -> None:
    """A run that had too little time for a single row; no sheet is drawn."""
    planned = recipes(("rgb", PRETRAINED), (0, 1))
    found = sor3d_report.run(planned, (), sor3d_report.Params(ablation=True), Scratch(tmp_path))
    assert json.loads(read(found, "metrics.json")) == {f"{row}.{name}": value for row in ("rgb", PRETRAINED)
                                                       for name, value in (("seeds", 0), ("unfinished", 2))}  # fmt: skip
    assert read(found, "report.md").count("0 of 2, not finished") == 2
    assert {Path(file.name).name for file in found.files} == {"metrics.json", "scores.json", "report.md"}


def test_recipes_begin_with_every_row() -> None:
    """The first seed of all rows comes before the second of any; the pretrained one is the whole model."""
    planned = recipes(("rgb", PRETRAINED), range(2))
    assert [(row_label(one), one.row, one.seed) for one in planned] == [
        ("rgb", "rgb", 0), (PRETRAINED, WHOLE, 0), ("rgb", "rgb", 1), (PRETRAINED, WHOLE, 1)]  # fmt: skip
    assert set(sor3d_report.Params.rows) == set(ALL) == set(ablation_rows.PUBLISHED_ROWS) | {PRETRAINED}
    for rows, seeds in ((("best",), (0,)), ((), (0,)), (("rgb",), ())):
        with pytest.raises(ValueError, match="sor3d: expected rows of rgb, rgb_attention"):
            recipes(rows, seeds)
