"""The recording of where hands belong on an object."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.palette import LEFT, RIGHT
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.contact_sheet import write_sheet
from afford.recording.moments import moments
from schemas.mesh import ObjectViews
from schemas.surface import PositiveAffordance, PositiveAffordances
from stages.recording import positive_record
from stages.surface import view_render
from tests.helpers.made_meshes import as_object, cup
from tests.helpers.made_samples import Scratch

ROOM = "/positive_affordance/0_drink_tea"


@pytest.fixture(scope="module")
def views() -> ObjectViews:
    return view_render.run(as_object(cup()), view_render.Params(size_px=64))


@pytest.fixture(scope="module")
def found() -> PositiveAffordances:
    """The left hand on one half of the faces, the right hand on the other; nothing is sure of the first ten."""
    count = len(as_object(cup()).faces)
    left = (np.arange(count) < count // 2).astype(np.float32)
    hand = np.stack([left, 1 - left]).astype(np.float32)
    hand[:, :10] = 0
    one = PositiveAffordance("drink tea", hand.max(0), hand, np.ones(count, np.float32), np.array([0.1, 0.2, 0.3, 0.4], np.float32),
                             np.zeros((5, 3), np.float32))  # fmt: skip
    return PositiveAffordances("cup", (one,))


def test_regions_of_both_hands_overlay_the_views(views: ObjectViews, found: PositiveAffordances, tmp_path: Path) -> None:
    """Each in its colour, transparent without affordance and off the object; points and taxonomy once."""
    made = positive_record.run(views, found, positive_record.Params(), Scratch(tmp_path))
    path = made.files[0].path
    shown = list(moments(path))
    assert len(shown) == len(views.views) and check_file(path) == check_content(path) == []
    said = json.loads(shown[0].one(f"{ROOM}/state").text)
    assert said["points"] == 5 and said["taxonomy"]["both_different"] == 0.4
    for view, moment in enumerate(shown):
        overlay, face = moment.picture(f"{ROOM}/overlay"), views.face[view]
        assert (overlay[face < 0][:, 3] == 0).all() and (overlay[(face >= 0) & (face < 10)][:, 3] == 0).all()
        for side, colour in ((0, LEFT), (1, RIGHT)):
            mine = (face >= 0) & (found.tasks[0].hand[side][face] > 0)
            assert (overlay[mine][:, :3] == colour).all() and (overlay[mine][:, 3] > 0).all()


def test_a_sheet_shows_the_tasks(views: ObjectViews, found: PositiveAffordances, tmp_path: Path) -> None:
    """A strip of views and one for the task; none for candidates, which there are not."""
    made = positive_record.run(views, found, positive_record.Params(), Scratch(tmp_path))
    write_sheet([made.files[0].path], tmp_path / "sheet.png")
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[0] < 3 * 240
