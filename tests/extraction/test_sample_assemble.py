"""sample_assemble: which frames become samples, and what they carry."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from afford.dataset.extraction_samples import MotionPaths, mask_centroid
from schemas.affordance import Affordances, FrameLabels, Rejection
from schemas.masks import CompleteObjects, Entity, Tracks
from schemas.video import Clip, Frames, Inpainted
from stages.extraction import sample_assemble
from tests.helpers.made_samples import narration

T, H, W = 12, 40, 60
FRAME = np.arange(1, T + 1, dtype=np.int64)
HANDS = (Entity("left hand", "left hand", 300, "hand", "left"), Entity("right hand", "right hand", 301, "hand", "right"))
MUG = Entity("mug#1", "mug", 13, "object", "")


def boxes(x0: int) -> np.ndarray:
    """A 10 x 10 box that moves right by 2 px a frame, (t, h, w)."""
    out = np.zeros((T, H, W), bool)
    for t in range(T):
        out[t, 10:20, x0 + 2 * t:x0 + 10 + 2 * t] = True
    return out


def extraction() -> dict:
    """A left hand that carries a mug, on every frame accepted and narrated."""
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (T, H, W, 3)).astype(np.uint8)
    hand, mug = boxes(5), boxes(10)
    said = narration(0), narration(1)
    clip = Clip("P01_s01", "P01", "P01", "train", ("P01.mp4",), "video", 50.0, False, 1, T, (), said, ())
    none = np.full((1, T), -1)
    return {
        "clip": clip,
        "frames": Frames("P01_s01", FRAME, (FRAME - 1) * 100_000_000, rgb),
        "inpainted": Inpainted("P01_s01", FRAME, 255 - rgb, hand, np.zeros((T, H, W), np.uint8),
                               np.full((T, H, W), 51, np.uint8)),
        "tracks": Tracks("P01_s01", (*HANDS, MUG), FRAME, np.stack([hand, np.zeros_like(hand), mug & ~hand]),
                         np.ones((3, T), np.float32), np.ones((3, T), np.uint8), np.ones((3, T), np.int64),
                         np.tile(np.arange(T, dtype=np.int32), (3, 1)), np.int16([[2] * T, [-1] * T]),
                         np.zeros((2, T), np.int32)),
        "complete": CompleteObjects("P01_s01", (MUG,), FRAME, mug[None], np.ones((1, T), np.float32)),
        "affordances": Affordances("P01_s01", (MUG,), FRAME, np.stack([mug & hand, np.zeros_like(hand)]),
                                   np.concatenate([none + 1, none]).astype(np.int16), np.zeros(T, np.int8),
                                   np.zeros(T, np.int8), np.linspace(0.1, 1, T).astype(np.float32), np.zeros(T, np.uint8)),
        "labels": FrameLabels("P01_s01", said, FRAME, np.zeros(T, np.int32), (), ()),
    }


def run(x: dict, **params):
    return sample_assemble.run(**x, params=sample_assemble.Params(**params))


def test_accepted_and_narrated_frames_give_samples():
    """Default parameters drop no accepted frame; a sample has the masks of its frame."""
    x = extraction()
    made = run(x)
    assert [sample.frame for sample in made.samples] == FRAME.tolist()
    for t, sample in enumerate(made.samples):
        assert np.array_equal(sample.masks[0], x["affordances"].masks[0, t])
        assert np.array_equal(sample.masks[2], x["complete"].masks[0, t])
        assert not sample.masks[[1, 3]].any()
        assert (sample.object_left, sample.object_right) == ("mug", "")


def test_image_is_the_inpainted_frame_as_jpeg():
    """The picture of a sample is the frame without hands; its confidence is the mean over the replaced pixels."""
    x = extraction()
    flat = replace(x["inpainted"], rgb=np.broadcast_to(np.uint8([200, 100, 30]), (T, H, W, 3)).copy())
    sample = run(x | {"inpainted": flat}).samples[0]
    decoded = cv2.imdecode(sample.image_jpeg, cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert np.abs(decoded - [200, 100, 30]).max() <= 3
    assert sample.inpaint_confidence == pytest.approx(0.2)


def test_dropped_frames_are_counted_under_their_first_reason():
    """Samples and reasons together account for all frames."""
    x = extraction()
    rejection = np.zeros(T, np.uint8)
    rejection[[0, 1]] = Rejection.TOO_SMALL
    labels = replace(x["labels"], frame=FRAME[1:-1], narration=np.zeros(T - 2, np.int32))
    made = run(x | {"affordances": replace(x["affordances"], rejection=rejection), "labels": labels},
               max_key_distance=8, min_quality=0.4, stride_frames=2)
    assert dict(made.rejected) == {"too_small": 2, "no_narration": 1, "far_from_key_frame": 2, "below_min_quality": 2,
                                   "between_strides": 2}
    assert [sample.frame for sample in made.samples] == [5, 7, 9]
    assert sum(count for _, count in made.rejected) + len(made.samples) == T


def test_policy_all_gives_one_sample_per_narration():
    """A frame with two narrations gives two samples with distinct ids."""
    x = extraction()
    labels = replace(x["labels"], frame=np.repeat(FRAME, 2), narration=np.tile(np.int32([0, 1]), T))
    made = run(x | {"labels": labels})
    assert len(made.samples) == 2 * T
    assert len({sample.sample_id for sample in made.samples}) == 2 * T
    assert made.samples[0].sample_id == "P01_0000000001_N_0"


def test_motion_follows_the_centroids():
    """Each point is the centroid at its step; what is out of sight or beyond the clip is NaN."""
    made = run(extraction(), motion_s=0.8, motion_steps=5)
    motion = made.samples[0].motion
    assert made.samples[0].motion_time_ns.tolist() == [0, 200_000_000, 400_000_000, 600_000_000, 800_000_000]
    np.testing.assert_allclose(motion[0, :, 0], 9.5 + 4 * np.arange(5))
    np.testing.assert_allclose(motion[2, :, 0], 14.5 + 4 * np.arange(5))
    np.testing.assert_allclose(motion[[0, 2], :, 1], 14.5)
    assert np.isnan(motion[[1, 3]]).all()
    last = made.samples[-1].motion
    assert np.isfinite(last[0, 0]).all() and np.isnan(last[0, 1:]).all()


def test_sparse_frames_have_no_motion_but_the_start():
    """Motion is not interpolated between frames that are seconds apart."""
    x = extraction()
    frames = replace(x["frames"], time_ns=x["frames"].time_ns * 100)
    motion = run(x | {"frames": frames}).samples[0].motion
    assert np.isfinite(motion[0, 0]).all() and np.isnan(motion[0, 1:]).all()


def test_centroid_of_nothing_is_nan():
    """An empty mask has no centroid."""
    assert np.isnan(mask_centroid(np.zeros((4, 5), bool))).all()


def test_one_step_is_refused():
    """A path of one point is no path."""
    x = extraction()
    with pytest.raises(ValueError, match="at least 2 steps"):
        MotionPaths(x["tracks"], x["complete"], x["frames"].time_ns, 1.0, 1)


def test_inputs_on_other_frames_are_refused():
    """A part that speaks of other frames is named."""
    x = extraction()
    with pytest.raises(ValueError, match=r"Inpainted\.frame differs"):
        run(x | {"inpainted": replace(x["inpainted"], frame=FRAME + 1)})


def test_an_object_without_complete_mask_is_refused():
    """The object that a hand holds must have been completed."""
    x = extraction()
    bare = replace(x["complete"], entities=(), masks=np.zeros((0, T, H, W), bool), confidence=np.zeros((0, T), np.float32))
    with pytest.raises(ValueError, match=r"CompleteObjects\.entities: .*mug#1 missing"):
        run(x | {"complete": bare})


def test_same_input_same_samples():
    """Two runs give equal bytes."""
    first, second = run(extraction()), run(extraction())
    assert all(np.array_equal(a.image_jpeg, b.image_jpeg) and np.array_equal(a.motion, b.motion, equal_nan=True)
               for a, b in zip(first.samples, second.samples, strict=True))
