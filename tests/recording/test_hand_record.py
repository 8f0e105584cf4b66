"""Recording of detected hands: keypoints over the frames and in space, contact, the contact sheet and viewers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.recording import contact_sheet, rerun_viewer
from afford.recording.foxglove_layout import layout
from afford.recording.moments import moments
from afford.recording.summary import summarise
from schemas.hands import DetectedHands, HandTracks
from schemas.video import Frames
from stages.recording import clip_record, stage_record
from tests.helpers.made_recordings import CLIP, Ctx, H, T, W, outputs

SHOWN = np.array([0, 2, 4])
"""sampled frames; the left hand is in all but the first, the right hand nowhere"""


def detected() -> DetectedHands:
    count = len(SHOWN)
    sure, px = np.zeros((2, count, 21), np.float32), np.zeros((2, count, 21, 2), np.float32)
    metres = np.zeros((2, count, 21, 3), np.float32)
    seen, contact = np.zeros((2, count), bool), np.zeros((2, count, 5), np.float32)
    seen[0, 1:], sure[0, 1:], contact[0, 2, :2] = True, 0.5, 0.9
    px[0, 1:] = np.stack([np.linspace(4, W - 8, 21), np.linspace(4, H - 8, 21)], axis=-1)
    metres[0, 1:] = np.stack([px[0, 1, :, 0] / 400, px[0, 1, :, 1] / 400, np.full(21, 0.5)], axis=-1)
    return DetectedHands(CLIP, HandTracks("c1", SHOWN + 1, (SHOWN + 1) * 40_000_000, 2 * W, 2 * H, seen, 2 * px, sure, metres,
                                          contact, 60.0))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames and detected hands of a clip."""
    folder, frames = tmp_path_factory.mktemp("hands"), outputs()["frame_decode"]
    assert isinstance(frames, Frames)
    parts = []
    for stage, value in (("frame_decode", frames), ("hand_detect", detected())):
        (folder / stage).mkdir()
        parts.append(stage_record.run(value, frames, stage_record.Params(stage), Ctx(folder / stage)))
    return clip_record.run(CLIP, tuple(parts), clip_record.Params(), Ctx(folder)).files[0].path


def test_topics_have_a_message_for_each_sampled_frame(recording: Path) -> None:
    counts = {topic.topic: topic.messages for topic in summarise(recording).topics}
    assert {name: counts[f"/hand_detect/{name}"] for name in ("outlines", "keypoints", "bones", "left", "right")} == {
        "outlines": 1, "keypoints": 3, "bones": 3, "left": 3, "right": 3}  # fmt: skip
    assert counts["/frame_decode/image"] == T


def test_keypoints_are_on_the_frame_and_in_space(recording: Path) -> None:
    found = list(moments(recording, ["/hand_detect/keypoints", "/hand_detect/bones", "/hand_detect/left"]))
    empty, free, touching = (moment.one("/hand_detect/keypoints").points for moment in found)
    assert (len(empty), len(free), len(touching)) == (0, 6, 7)
    wrist = touching[0].points[0]
    assert (wrist.x, wrist.y) == pytest.approx((4.25, 4.25))
    assert len(touching[5].points) == 21 and len(touching[6].points) == 2
    assert touching[0].outline_color.a == pytest.approx(0.625)
    left, right = found[2].one("/hand_detect/bones").entities
    assert (left.id, left.frame_id, len(left.lines), len(right.lines)) == ("left", "camera", 5, 0)
    assert left.lines[0].points[0].z == pytest.approx(0.5)
    state = found[2].one("/hand_detect/left")
    assert state.thumb_contact == pytest.approx(0.9) and state.ring_contact == 0 and state.palm_m == pytest.approx(0.5)


def test_contact_sheet_shows_the_bones(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture differs where the bones are; frames between sampled ones have those of the nearest."""
    chosen = list(moments(recording, times_ns=[4 * 40_000_000]))
    assert "/hand_detect/keypoints" not in chosen[0].values
    (moment,) = contact_sheet._with_keypoints(recording, chosen)
    blank = np.full((contact_sheet.TILE_W * H // W, contact_sheet.TILE_W, 3), 255, np.uint8)
    drawn = contact_sheet._draw_keypoints(blank, moment)
    assert drawn.shape == blank.shape and 0 < (drawn != blank).any(axis=-1).mean() < 0.2
    contact_sheet.write_sheet([recording], tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 1000


def test_viewers_show_the_hands(recording: Path, tmp_path: Path) -> None:
    panels = layout(summarise(recording))["configById"]
    assert panels["3D!space"]["followTf"] == "camera"
    assert panels["Image!frame_decode_image"]["imageMode"]["annotations"]["/hand_detect/keypoints"] == {"visible": True}
    rerun_viewer.save(recording, tmp_path / "c.rrd")
    from rerun.chunk import RrdReader

    paths = {str(chunk.entity_path) for chunk in RrdReader(tmp_path / "c.rrd").stream()}
    assert {"/hands", "/frame/bones", "/frame/keypoints"} <= paths
