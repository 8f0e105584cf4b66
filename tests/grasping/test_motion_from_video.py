"""Hand motion from video: even resampling, gaps, phases, object names, remarks, and files that are read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.motion.from_video import camera_axes
from afford.grasping.motion.skeleton import pose_hand
from schemas.hand import PHASES
from schemas.hands import HandTracks, MotionRemarks, VideoMotions
from schemas.video import Annotation, Clip, KeyFrame
from stages.grasping import hand_motion, keypoint_files, motion_read
from tests.helpers.made_motions import tree
from tests.helpers.made_recordings import Ctx

FRAMES, FPS = 60, 15.0
PITCH = 40.0
LIFTED = slice(40, 60)


def grasp() -> np.ndarray:
    """A right hand (60, 21, 3) in the world that opens, reaches along y, closes at frame 30 and lifts from frame 40 on."""
    k = np.arange(FRAMES)
    closing = np.interp(k, [0, 20, 30, 59], [0.4, 0.0, 0.8, 0.8])
    points = pose_hand(closing, np.zeros(FRAMES))[..., [0, 2, 1]] * [1, 1, -1]
    way = np.stack([0 * k, np.interp(k, [0, 30], [0, 0.3]), np.interp(k, [40, 59], [0, 0.15])], axis=-1)
    return np.asarray(points + way[:, None])


def tracks(world: np.ndarray, side: int = 1) -> HandTracks:
    """The tracks of one hand, seen by a camera 0.5 m above and 0.3 m behind the origin."""
    seen, sure = np.zeros((2, FRAMES), bool), np.zeros((2, FRAMES, 21), np.float32)
    seen[side], sure[side] = True, 0.9
    points, contact = np.zeros((2, FRAMES, 21, 3), np.float32), np.zeros((2, FRAMES, 5), np.float32)
    points[side] = (world - [0, -0.3, 0.5]) @ camera_axes(PITCH)
    contact[side, :, :2], contact[side, 30:, :2] = 0.1, 0.9
    time_ns = (np.arange(FRAMES) / FPS * 1e9).astype(np.int64)
    return HandTracks("clip", np.arange(1, FRAMES + 1), time_ns, 456, 256, seen, np.zeros((2, FRAMES, 21, 2), np.float32), sure,
                      points, contact, 320.0)


def clip(*key_frames: KeyFrame) -> Clip:
    return Clip("clip", "clip", "", "", ("a.mp4",), "video", FPS, False, 1, FRAMES, key_frames, (), ())


def key(frame: int, contact: str, side: str = "right", name: str = "mug") -> KeyFrame:
    hand = Annotation("h", f"{side} hand", 301, side, contact, "y", ())  # type: ignore[arg-type]
    return KeyFrame(frame, 456, 256, (hand, Annotation("o", name, -1, "", "", "y", ())))


def motions(hands: HandTracks, given: Clip | None = None, **params: float) -> VideoMotions:
    return hand_motion.run(hands, given or clip(), hand_motion.Params(pitch_deg=PITCH, **params))


def words(found: VideoMotions) -> list[str]:
    """Phases of the first motion, without repetitions."""
    phase = [PHASES[k] for k in found.motions[0].phase]
    return [word for k, word in enumerate(phase) if k == 0 or phase[k - 1] != word]


def test_keypoints_return_to_the_world_up_to_a_shift():
    world = grasp()
    (one,) = motions(tracks(world), rate_hz=FPS).motions
    assert (one.name, one.side, one.rate_hz, one.source) == ("clip-right-01", "right", FPS, "video")
    shift = one.keypoints_m - world
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0, 0], shift.shape), atol=1e-5)
    assert abs(float(np.percentile(one.keypoints_m[..., 2], 2))) < 1e-6


def test_resampling_is_even_and_keeps_the_samples():
    world = grasp()
    (twice,), (same,) = (motions(tracks(world), rate_hz=rate).motions for rate in (2 * FPS, FPS))
    assert len(twice.keypoints_m) == 2 * FRAMES - 1
    np.testing.assert_allclose(twice.keypoints_m[::2], same.keypoints_m, atol=1e-9)


def test_short_gaps_are_interpolated_and_long_gaps_split():
    hands = tracks(grasp())
    whole = motions(hands, rate_hz=FPS).motions[0].keypoints_m
    short, long = hands.confidence.copy(), hands.confidence.copy()
    short[1, 12:15], long[1, 20:28] = 0, 0
    (bridged,) = motions(replace(hands, confidence=short), rate_hz=FPS).motions
    np.testing.assert_allclose(bridged.keypoints_m, whole, atol=0.01)
    first, second = motions(replace(hands, confidence=long), rate_hz=FPS).motions
    assert [len(first.keypoints_m), len(second.keypoints_m)] == [20, 32]
    assert [first.name, second.name] == ["clip-right-01", "clip-right-02"]


def test_phases_follow_contact_aperture_and_height():
    assert words(motions(tracks(grasp()))) == ["reach", "close", "hold", "lift"]
    unknown = replace(tracks(grasp()), finger_contact=np.zeros((2, FRAMES, 5), np.float32))
    assert words(motions(unknown)) == ["unknown"]


def test_key_frames_give_contact_where_fingers_do_not_and_the_name():
    unknown = replace(tracks(grasp()), finger_contact=np.zeros((2, FRAMES, 5), np.float32))
    keys = [key(frame, "o" if frame > 30 else "hand-not-in-contact") for frame in range(1, FRAMES + 1, 6)]
    found = motions(unknown, clip(*keys))
    assert found.motions[0].object_name == "mug"
    assert words(found) == ["reach", "close", "hold", "lift"]
    assert motions(unknown, clip(*[replace_name(one, "object:2") for one in keys])).motions[0].object_name == ""
    assert motions(unknown, clip(key(40, "o", "left"))).motions[0].object_name == ""


def replace_name(one: KeyFrame, name: str) -> KeyFrame:
    return replace(one, annotations=(one.annotations[0], replace(one.annotations[1], name=name)))


def test_unsure_runs_become_remarks():
    hands = tracks(grasp())
    faint = motions(replace(hands, confidence=hands.confidence * 0.2))
    assert faint.motions == () and "confidence" in faint.remarks.texts[0] and "right hand" in faint.remarks.texts[0]
    nothing = motions(replace(hands, confidence=0 * hands.confidence))
    assert nothing.motions == () and "no landmarks" in nothing.remarks.texts[0]
    brief = hands.confidence.copy()
    brief[1, 5:50] = 0
    some = motions(replace(hands, confidence=brief))
    assert len(some.motions) == 1 and "1 of 2 runs of the right hand" not in some.remarks.texts
    assert some.remarks.texts == ("1 of 2 runs of the right hand are shorter than 0.6 s and left out",)
    assert motions(replace(hands, confidence=0 * brief, seen=np.zeros((2, FRAMES), bool))).remarks.texts == ()


def test_frames_with_fingers_that_bend_backwards_are_gaps():
    """A reflection in depth bends the fingers backwards; three such frames are interpolated, a whole run is no motion."""
    hands, wrong = tracks(grasp()), np.array([1, 1, -1], np.float32)
    whole = motions(hands, rate_hz=FPS).motions[0].keypoints_m
    some, every = hands.keypoints_m.copy(), hands.keypoints_m * wrong
    some[1, 34:37] *= wrong
    (bridged,) = motions(replace(hands, keypoints_m=some), rate_hz=FPS).motions
    np.testing.assert_allclose(bridged.keypoints_m, whole, atol=0.01)
    found = motions(replace(hands, keypoints_m=every))
    assert all(len(one.keypoints_m) < 40 for one in found.motions) and found.remarks.texts


def test_both_hands_share_one_world():
    right, left = tracks(grasp(), 1), tracks(grasp() * [-1, 1, 1] + [0.2, 0, 0.1], 0)
    both = replace(right, confidence=right.confidence + left.confidence, keypoints_m=right.keypoints_m + left.keypoints_m)
    one, other = motions(both).motions
    assert (one.side, other.side) == ("left", "right")
    apart = one.keypoints_m - other.keypoints_m * [-1, 1, 1]
    np.testing.assert_allclose(apart, np.broadcast_to([0.2, 0, 0.1], apart.shape), atol=1e-5)


def test_files_are_read_back_equal(tmp_path: Path):
    found = motions(tracks(grasp()), clip(key(40, "o"))).motions
    files = keypoint_files.run(found, (MotionRemarks("clip", ("a remark",)),), keypoint_files.Params("mine"), Ctx(tmp_path))
    assert [file.name for file in files.files] == ["clip-right-01.npz", "remarks.txt"]
    (again,) = motion_read.run(tree(*(file.path for file in files.files)), motion_read.Params())
    assert replace(again, source="video").name == found[0].name
    for name in ("side", "rate_hz", "object_name"):
        assert getattr(again, name) == getattr(found[0], name)
    np.testing.assert_array_equal(again.keypoints_m, found[0].keypoints_m)
    np.testing.assert_array_equal(again.phase, found[0].phase)


def test_no_motion_is_an_error_with_the_remarks(tmp_path: Path):
    with pytest.raises(ValueError, match=r"mine: the video gives no hand motion \(clip: too dark\)"):
        keypoint_files.run((), (MotionRemarks("clip", ("too dark",)),), keypoint_files.Params("mine"), Ctx(tmp_path))


@pytest.mark.parametrize(("name", "bad"), [("rate_hz", 0.0), ("min_s", -1.0), ("pitch_deg", 100.0)])
def test_parameters_out_of_range_are_named(name: str, bad: float):
    with pytest.raises(ValueError, match=name):
        hand_motion.run(tracks(grasp()), clip(), replace(hand_motion.Params(), **{name: bad}))
