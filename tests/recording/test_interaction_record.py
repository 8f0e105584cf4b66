"""Recording of an interaction: strict checks pass, every frame has its inputs and predictions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.files import tree
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.contact_sheet import write_sheet
from afford.recording.foxglove_layout import layout
from afford.recording.interactions import ACTION, ATTENTION, DEPTH, FLOW, FRAME, LIKELIEST, LOG, TRUTH
from afford.recording.moments import moments
from afford.recording.summary import summarise
from afford.rgbd.model.predictor import Predictor, first_frames, sequence_of
from pipeline import main
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND
from stages.recording import interaction_record
from stages.rgbd import interaction_pack
from tests.helpers.made_samples import Scratch
from tests.helpers.made_sequences import FRAMES, SIZE, interaction
from tests.helpers.tiny_sor3d import write_model

CLIP, MOTION = interaction(0, "val")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("trained")
    write_model(root / "model")
    return root


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    made = [interaction(n, split) for split, count in (("train", 1), ("val", 3)) for n in range(count)]
    clips, flows = zip(*made, strict=True)
    params = interaction_pack.Params(licence="cc0-1.0")
    return interaction_pack.run(clips, flows, params, Scratch(tmp_path_factory.mktemp("packed")))


@pytest.fixture(scope="module")
def recorded(dataset: FileTree, model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    files = interaction_record.run(dataset, tree("sor3d", model), interaction_record.Params(shown=1),
                                   Scratch(tmp_path_factory.mktemp("recorded")))  # fmt: skip
    assert [file.name for file in files.files] == [f"{CLIP.name}.mcap", f"{CLIP.name}.png"]
    return files.files[0].path


def test_recording_is_intact_and_has_panels(recorded: Path) -> None:
    """No problem found by `inspect --strict`; its pictures and the curves of the actions have panels."""
    assert check_file(recorded) == [] and check_content(recorded) == []
    panels = json.dumps(layout(summarise(recorded)))
    assert all(f"{ACTION}.{name}" in panels for name in AFFORDANCES) and ATTENTION in panels


def test_frames_have_inputs_and_predictions(recorded: Path, model: Path) -> None:
    """Depth in millimetres, the motion that led to the frame, labels and action of the sequence that ends there."""
    predictor, shown = Predictor(model / "model"), list(moments(recorded))
    seen = predictor.inputs_of_clip(CLIP, MOTION)
    assert [moment.time_ns for moment in shown] == [n * 100_000_000 for n in range(FRAMES)]
    for n, moment in enumerate(shown):
        found = predictor.predict(first_frames(seen, n + 1))
        depth = cv2.imdecode(np.frombuffer(moment.one(DEPTH).data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert depth.dtype == np.uint16 and np.array_equal(depth, (1000 * CLIP.depth_m[n]).round())
        expected = MOTION.colour[n - 1] if n else np.full((SIZE, SIZE, 3), 128)
        assert np.array_equal(moment.picture(FLOW), expected)
        assert np.array_equal(moment.picture(LIKELIEST)[..., 3] > 0, found.label != BACKGROUND)
        state = moment.one(ACTION)
        assert [getattr(state, name) for name in AFFORDANCES] == pytest.approx(found.action.tolist(), abs=1e-6)
        assert state.said == AFFORDANCES[found.action.argmax()] and moment.picture(ATTENTION).std() > 0
        assert moment.picture(FRAME).shape == (SIZE, SIZE, 3) and (moment.one(TRUTH) is None) == (n < FRAMES - 1)
    assert np.array_equal(shown[-1].picture(TRUTH)[..., 3] > 0, CLIP.label != BACKGROUND)
    assert "push is done" in shown[-1].one(LOG).message


def test_the_sheet_is_that_of_inspect(recorded: Path, tmp_path: Path) -> None:
    """The same pixels; all frames are in it."""
    write_sheet([recorded], tmp_path / "sheet.png")
    page = cv2.imread(str(tmp_path / "sheet.png"))
    assert np.array_equal(page, cv2.imread(str(recorded.with_suffix(".png")))) and page.shape[0] > 7 * 150 and page.std() > 20


def test_number_of_recorded_sequences(dataset: FileTree, model: Path, tmp_path: Path) -> None:
    """0 records all of the split; an unknown split, or a rate of 0, is refused."""
    usual = interaction_record.Params()
    flat = tree("sor3d", write_model(tmp_path / "flat", "rgb").parent / "flat")
    found = interaction_record.run(dataset, flat, replace(usual, shown=0), Scratch(tmp_path / "all"))
    assert len(found.files) == 6
    topics = {topic.topic for topic in summarise(found.files[0].path).topics}
    assert ATTENTION not in topics and check_content(found.files[0].path) == []
    for params, hint in ((replace(usual, split="test"), "test/"), (replace(usual, rate_hz=0.0), "rate_hz above 0")):
        with pytest.raises(ValueError, match=hint):
            interaction_record.run(dataset, tree("sor3d", model), params, Scratch(tmp_path / "none"))


def test_the_flow_of_another_sequence_is_refused() -> None:
    """The error names the sequence."""
    with pytest.raises(ValueError, match="expected its own scene flow"):
        sequence_of(CLIP, interaction(1, "val")[1], "3d")


def test_rerun_gets_pictures_and_curves(recorded: Path, tmp_path: Path) -> None:
    """--save: the frame with its overlays, depth in metres, a curve for each action, words."""
    out = tmp_path / "interaction.rrd"
    assert main(["inspect", str(recorded), "--save", str(out)]) == 0
    from rerun.chunk import RrdReader

    found: dict[str, set[str]] = {}
    for chunk in RrdReader(out).stream():
        found.setdefault(str(chunk.entity_path), set()).update(chunk.to_record_batch().schema.names)
    assert {"/frame/image", "/likeliest/affordance", "/confident/affordance", "/truth/affordance", "/attention", "/motion", "/log",
            *(f"/action/{name}" for name in AFFORDANCES)} <= set(found)  # fmt: skip
    assert "DepthImage:meter" in found["/depth"] and "EncodedImage:blob" in found["/likeliest/image"]
