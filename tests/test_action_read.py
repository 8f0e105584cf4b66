"""UTKinect: intervals of actions become clips."""

from __future__ import annotations

import numpy as np
import pytest

from afford.readers.errors import SourceError
from stages import action_read
from tests.made_interactions import folder, utkinect


def test_actions_become_clips(tmp_path) -> None:
    """Frames that are there, spread evenly; depth without the player's bits; actions marked NaN left out."""
    (clip,) = action_read.run(utkinect(tmp_path), action_read.Params(size_px=16, frames=3))
    assert (clip.name, clip.action, clip.rgb.shape, clip.depth_m.shape) == ("s01_e01_walk", "walk", (3, 16, 16, 3), (3, 16, 16))
    assert np.abs(clip.rgb[:, 0, 0, 0].astype(int) - [100, 140, 160]).max() <= 2
    assert (clip.depth_m == 1.0).all()


def test_a_clip_with_a_gap_in_depth_has_none(tmp_path) -> None:
    """Rather than half of it."""
    utkinect(tmp_path)
    (tmp_path / "depth" / "s01_e01" / "depthImg12.xml").unlink()
    (clip,) = action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
    assert len(clip.rgb) == 4 and (clip.depth_m == 0).all()


@pytest.mark.parametrize(("name", "text", "said"), [
    ("actionLabel.txt", "s01_e01\nwalk: 3\n", "line 2: expected action: first last"),
    ("actionLabel.txt", "s02_e01\nwalk: 3 9\n", "colorImg<number>.jpg of an action"),
    ("depth/s01_e01/depthImg10.xml", "<a><width>8</width>", "as many numbers in data"),
    ("depth/s01_e01/depthImg10.xml", "<!DOCTYPE a><a/>", "expected plain XML"),
])  # fmt: skip
def test_faults(name: str, text: str, said: str, tmp_path) -> None:
    """One sentence each."""
    utkinect(tmp_path)
    (tmp_path / name).write_text(text)
    with pytest.raises(SourceError, match=said):
        action_read.run(folder(tmp_path, "utkinect"), action_read.Params(size_px=16))
