"""The recording of an object: strict checks pass, every view has its pictures, clouds carry their labels."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from afford.common.drawing import GAP, TITLE_H
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.contact_sheet import write_sheet
from afford.recording.moments import moments
from afford.recording.objects import CANDIDATES, NEGATIVE, NOTES, SCORES, VIEW
from afford.recording.strips import OBJECT_SIDE, OBJECT_VIEWS
from stages.recording import object_record
from tests.helpers.made_objects import looked, projected, true_scores
from tests.helpers.made_samples import Scratch


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    x = looked()
    files = object_record.run(x.views, x.candidates, x.told, true_scores(x), projected(x), object_record.Params(),
                              Scratch(tmp_path_factory.mktemp("recorded")))  # fmt: skip
    assert [file.name for file in files.files] == ["screwdriver_3.mcap"]
    return files.files[0].path


def test_recording_is_intact(recorded: Path) -> None:
    """No problem found by `inspect --strict`."""
    assert check_file(recorded) == [] and check_content(recorded) == []


def test_views_have_their_pictures(recorded: Path) -> None:
    """View, candidates and one overlay for each task, of one size; overlays are transparent off the object, red on the part."""
    x, shown = looked(), list(moments(recorded))
    assert len(shown) == len(x.views.views)
    overlay = f"{NEGATIVE}/0_drive_a_screw/overlay"
    shaft = np.append(x.parts.part == x.parts.names.index("shaft"), False)
    large = 0
    for view, moment in enumerate(shown):
        assert moment.time_ns == view * 1_000_000
        assert moment.picture(VIEW).shape == (*x.views.face.shape[1:], 3) and moment.picture(CANDIDATES).shape[2] == 4
        painted = moment.picture(overlay).astype(int)
        assert ((painted[..., 3] > 0) == (x.views.face[view] >= 0)).all()
        on = shaft[x.views.face[view]]
        large += on.sum() > 30
        assert on.sum() <= 30 or (painted[on, 0] > painted[on, 1]).mean() > 0.95
    assert large > 2


def test_scores_and_notes_are_recorded(recorded: Path) -> None:
    """Candidates of each view with their shares; parts with their roles, per task."""
    x, first = looked(), next(iter(moments(recorded)))
    scores = json.loads(first.one(SCORES).text)
    assert len(scores) == (x.candidates.view == 0).sum() and set(scores[0]["share"]) == set(x.parts.names)
    notes = json.loads(first.one(NOTES).text)
    assert [one["task"] for one in notes] == [one.task for one in x.told.descriptions]
    assert {note["part"]: note["role"] for note in notes[0]["notes"]}["shaft"] == "negative"


def test_clouds_carry_labels_as_colours(recorded: Path) -> None:
    """Red for negative points, in metres and the object's frame; N_t is all red."""
    x, found = looked(), projected(looked())
    with recorded.open("rb") as stream:
        read = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        clouds = {channel.topic: value for _, channel, _, value in read if value.DESCRIPTOR.full_name == "foxglove.PointCloud"}
    kind = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)])
    for number, one in enumerate(found.tasks):
        room = next(topic.rpartition("/")[0] for topic in clouds if topic.startswith(f"{NEGATIVE}/{number}_"))
        points = np.frombuffer(clouds[f"{room}/points"].data, kind)
        assert np.array_equal(points["xyz"], found.points) and np.array_equal(points["rgba"][:, 0] > 150, one.negative)
        assert np.array_equal(np.frombuffer(clouds[f"{room}/N_t"].data, kind)["xyz"], one.N_t)
        assert clouds[f"{room}/points"].frame_id == "object" and clouds[f"{room}/points"].point_stride == kind.itemsize
    assert x.mesh.name == "screwdriver_3"


def test_the_sheet_shows_views_candidates_and_tasks(recorded: Path, tmp_path: Path) -> None:
    """Four strips of six views, each with its title; red on what is negative."""
    write_sheet([recorded], tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))[..., ::-1].astype(int)
    tasks = len(looked().told.descriptions)
    assert sheet.shape == ((2 + tasks) * (TITLE_H + OBJECT_SIDE + GAP), OBJECT_VIEWS * (OBJECT_SIDE + GAP), 3)
    strips = sheet.reshape(2 + tasks, TITLE_H + OBJECT_SIDE + GAP, -1, 3)
    red = (strips[..., 0] - strips[..., 1] > 60).sum((1, 2))
    assert (red[2:] > 300).all()
