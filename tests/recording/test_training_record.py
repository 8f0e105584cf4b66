"""Recordings of trainings: curves, sample frames and parameters below the name of the stage."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from afford.common.files import tree
from afford.common.image_files import jpeg
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.contact_sheet import write_sheet
from afford.recording.mcap_files import EPOCH_NS
from afford.recording.moments import moments
from afford.recording.trainings import Preview, record_training
from afford.surface.score import part_scorer as parts_files
from afford.surface.score import train_scorer as parts
from afford.surface.score.part_scorer import PartScorerConfig
from schemas.files import FileTree
from schemas.surface import PartLessons
from schemas.training import Curve, TrainingLog
from stages.recording import scorer_record, training_record
from tests.helpers.made_samples import Scratch

LOG = TrainingLog("toy", (Curve("train.total", np.array([1, 2]), np.array([3.0, 2.0])),
                          Curve("val.iou", np.array([2]), np.array([0.5]))), 2, 2)  # fmt: skip
PARAMETERS = (("hands_train", json.dumps({"lr": 0.003, "steps": 2})),)


def metadata(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as stream:
        return {one.name: one.metadata for one in make_reader(stream).iter_metadata()}


def whole(path: Path) -> bool:
    return not check_file(path) and not check_content(path)


@pytest.fixture
def files(tmp_path: Path) -> FileTree:
    """Files of a training with one preview."""
    (tmp_path / "files" / "previews").mkdir(parents=True)
    (tmp_path / "files" / "previews" / "step_0000002.jpg").write_bytes(jpeg(np.full((24, 32, 3), 90, np.uint8)))
    return tree("toy", tmp_path / "files")


def test_topics_are_those_of_the_stage(files: FileTree, tmp_path: Path) -> None:
    """A millisecond a step; the parameters and the digest of the files are in the metadata."""
    made = training_record.run(LOG, files, training_record.Params("hands_train", PARAMETERS), Scratch(tmp_path))
    path = made.files[0].path
    found = [(moment.time_ns, sorted(moment.values)) for moment in moments(path)]
    assert found == [(1_000_000, ["/hands_train/train/total"]),
                     (2_000_000, ["/hands_train/log", "/hands_train/preview", "/hands_train/train/total", "/hands_train/val/iou"])]
    about = metadata(path)
    assert about["parameters/hands_train"] == {"lr": "0.003", "steps": "2"} and about["provenance/hands_train"]["artifact"]
    assert whole(path)
    with pytest.raises(ValueError, match="toy: no curves to record"):
        training_record.run(replace(LOG, curves=()), files, training_record.Params(), Scratch(tmp_path))


def test_previews_after_the_last_step_keep_their_rate() -> None:
    """Episodes and sheets follow the curves in time; a log line goes with the first of their frames."""
    shown = [Preview(EPOCH_NS + 10**9 * n, b"\xff\xd8\xff", "begin" if n == 1 else "") for n in (1, 2)]
    recording = record_training(LOG, "x", shown)
    late = [message.topic for message in recording.messages if message.time_ns >= EPOCH_NS + 10**9]
    assert late == ["/x/preview", "/x/log", "/x/preview"] or sorted(late) == ["/x/log", "/x/preview", "/x/preview"]
    assert not any(one.topic == "/x/preview" for one in record_training(LOG, "x", []).channels)


def test_scorer_is_shown_on_validation_objects(tmp_path: Path) -> None:
    """A sheet for each validation object, none of training; the sheet of the recording has curves too."""
    model = parts.init_scorer(PartScorerConfig(), 0)
    root = parts_files.save_scorer(tmp_path, model, "card")
    rng = np.random.default_rng(0)
    lessons = tuple(PartLessons(
        f"knife_{split}", "knife", split, ("handle", "blade"), rng.integers(0, 255, (5, 2, 6, 48, 48)).astype(np.uint8),
        np.zeros((5, model.image[0].in_features - 2 * PartScorerConfig().widths[-1]), np.float32),
        rng.random((5, 2)).astype(np.float32), rng.random((5, 2)).astype(np.float32)) for split in ("train", "val"))  # fmt: skip
    made = scorer_record.run(lessons, LOG, tree("part-scorer", root), scorer_record.Params(), Scratch(tmp_path))
    path = made.files[0].path
    said = [one.message for moment in moments(path, ["/scorer_train/log"]) for one in moment.values["/scorer_train/log"]]
    assert any(line.startswith("knife_val: ") for line in said) and not any("knife_train" in line for line in said)
    assert whole(path)
    write_sheet([path], tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 1000
