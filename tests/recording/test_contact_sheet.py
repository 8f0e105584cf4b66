"""Kind of recordings that a contact sheet shows."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.drawing import TILE_BACKGROUND
from afford.recording import contact_sheet


def strips(shade: int) -> contact_sheet.Strips:
    return lambda path: [np.full((2, len(path.stem), 3), shade, np.uint8)]


def test_sheet_shows_recordings_of_the_first_matching_kind(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two objects, a grasp and a clip in any order: the objects, in the given order; without them the grasp."""
    table = ((lambda path: path.suffix == ".object", strips(50)), (lambda path: path.suffix == ".grasp", strips(90)))
    monkeypatch.setattr(contact_sheet, "OWN_STRIPS", table)
    given = [Path("aaaa.grasp"), Path("bbb.object"), Path("clip.mcap"), Path("cc.object")]
    contact_sheet.write_sheet(given, tmp_path / "objects.png")
    page = cv2.imread(str(tmp_path / "objects.png"))
    assert page.shape == (4, 3, 3) and (page[:2] == 50).all() and (page[2:, :2] == 50).all()
    assert (page[2:, 2] == TILE_BACKGROUND[::-1]).all()
    contact_sheet.write_sheet([path for path in given if path.suffix != ".object"], tmp_path / "grasps.png")
    assert (cv2.imread(str(tmp_path / "grasps.png")) == np.full((2, 4, 3), 90)).all()
