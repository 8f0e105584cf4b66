"""UTKinect: intervals of actions become clips."""

from __future__ import annotations

import numpy as np
import pytest

from afford.common.errors import SourceError
from stages.rgbd import action_read
from tests.helpers.made_interactions import folder, utkinect


def test_actions_become_clips(tmp_path) -> None:
    """Frames that are there, spread evenly; depth without the player's bits; actions marked NaN left out."""
    (clip,) = action_read.run(utkinect(tmp_path), action_read.Params(size_px=16, frames=3))
    assert (clip.name, clip.action, clip.rgb.shape, clip.depth_m.shape) == ("s01_e01_walk", "walk", (3, 16, 16, 3), (3, 16, 16))
    assert np.abs(clip.rgb[:, 0, 0, 0].astype(int) - [100, 140, 160]).max() <= 2
    assert (clip.depth_m == 1.0).all()


def test_clip_with_a_gap_in_depth_has_no_depth(tmp_path) -> None:
    """One missing depth frame removes the depth of the clip."""
    utkinect(tmp_path)
    (tmp_path / "depth" / "s01_e01" / "depthImg12.xml").unlink()
    (clip,) = action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
    assert len(clip.rgb) == 4 and (clip.depth_m == 0).all()


def test_an_action_that_states_more_frames_than_there_are_has_those(tmp_path) -> None:
    """Spread over the available frames, not over the stated numbers."""
    utkinect(tmp_path)
    (whole,) = action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
    (tmp_path / "actionLabel.txt").write_text(f"s01_e01\nwalk: 0 {10**18}\n")
    (clip,) = action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
    assert np.array_equal(clip.rgb, whole.rgb)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("actionLabel.txt", "s01_e01\nwalk: 3\n", "line 2: expected action: first last"),
    ("actionLabel.txt", b"s01_e01\nwalk\xff: 3 9\n", "actionLabel.txt: expected text in UTF-8"),
    ("actionLabel.txt", f"s01_e01\nwalk: {10**17} {10**18}\n", "colorImg<number>.jpg of an action"),
    ("depth/s01_e01/depthImg10.xml", f"<a><width>1</width><height>1</height><data>{'9' * 30}</data></a>",
     "as many numbers in data"),
    ("actionLabel.txt", "s02_e01\nwalk: 3 9\n", "colorImg<number>.jpg of an action"),
    ("depth/s01_e01/depthImg10.xml", "<a><width>8</width>", "as many numbers in data"),
    ("depth/s01_e01/depthImg10.xml", "<!DOCTYPE a><a/>", "expected plain XML"),
])  # fmt: skip
def test_errors_name_the_file(name: str, text: str | bytes, message: str, tmp_path) -> None:
    """Each error is one sentence."""
    utkinect(tmp_path)
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SourceError, match=message):
        action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
