"""Laws of masks from landmarks: shape and colour, sleeves, gaps, two hands, and what is no hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.codecs import CODEC
from afford.common.masks import iou
from afford.extraction.hands.fuse import FoundHands, find_hands
from afford.extraction.hands.hand_masks import wrist_turn
from afford.extraction.hands.motion import sample_frames
from afford.extraction.landmarks.geometry import draw_forearm
from schemas.hands import HandLandmarks
from schemas.video import Frames
from stages.extraction import hand_detect
from tests.extraction.test_hand_detect import clip_of
from tests.helpers.made_landmarks import SIZE_WH, MadeHand, made_video, path, still

COUNT = 12


def find(frames: Frames, landmarks: HandLandmarks, viewpoint: str = "ego") -> FoundHands:
    params = hand_detect.Params(viewpoint=viewpoint)  # type: ignore[arg-type]  # one of two
    return find_hands(sample_frames(frames, params.look_s, landmarks.frame), landmarks, None, params)


def test_masks_follow_shape_and_colour() -> None:
    """The mask of a hand is its skin with the bare forearm; with a sleeve it ends at the sleeve."""
    for sleeve in (None, (40, 60, 160)):
        hand = MadeHand(path((120, 130), (200, 120), COUNT), sleeve=sleeve)
        found = find(*made_video([hand]))
        masks = {**found.masks["left"], **found.masks["right"]}
        assert sorted(masks) == list(range(COUNT))
        assert min(iou(masks[t], hand.mask(t)) for t in range(COUNT)) > 0.7
        if sleeve is not None:
            assert max((masks[t] & hand.arm(t)).sum() / masks[t].sum() for t in range(COUNT)) < 0.15


def test_a_hand_is_followed_without_landmarks() -> None:
    """Frames without landmarks between others get a mask, and no keypoints."""
    hand = MadeHand(path((120, 130), (190, 125), COUNT), found=(0, 1, 2, 3, 7, 8, 9, 10, 11))
    found = find(*made_video([hand]))
    (side,) = [side for side in ("left", "right") if found.masks[side]]
    assert {4, 5, 6} <= found.masks[side].keys() and not {4, 5, 6} & found.points[side].keys()
    assert min(iou(found.masks[side][t], hand.mask(t)) for t in (4, 5, 6)) > 0.6


def test_two_hands_have_two_sides() -> None:
    """The left hand is on the left for a head camera, and on the right for a person opposite. Masks do not overlap."""
    for down, viewpoint in ((False, "ego"), (True, "facing")):
        y = 120 if not down else 60
        hands = [MadeHand(still(90, y, COUNT), left=not down, down=down), MadeHand(still(230, y, COUNT), left=down, down=down)]
        found = find(*made_video(hands), viewpoint=viewpoint)
        for t in range(COUNT):
            left, right = found.masks["left"][t], found.masks["right"][t]
            assert not (left & right).any()
            centres = [np.nonzero(mask)[1].mean() for mask in (left, right)]
            assert (centres[0] < centres[1]) == (not down)


def test_sides_swap_in_a_mirror() -> None:
    """The mirror image of a video has the hands of the other sides."""
    frames, landmarks = made_video([MadeHand(still(90, 120, COUNT), left=True), MadeHand(still(230, 120, COUNT))])
    mirrored = replace(frames, rgb=np.ascontiguousarray(frames.rgb[:, :, ::-1]))
    points = landmarks.keypoints_px.copy()
    points[..., 0] = 2 * SIZE_WH[0] - 1 - points[..., 0]
    one, other = find(frames, landmarks), find(mirrored, replace(landmarks, keypoints_px=points, right=1 - landmarks.right))
    for t in range(COUNT):
        assert iou(one.masks["left"][t], other.masks["right"][t][:, ::-1]) > 0.8


@pytest.mark.parametrize("hand", [
    MadeHand(still(160, 120, COUNT), presence=0.4), MadeHand(still(160, 120, COUNT), colour=None),
    MadeHand(still(160, 120, COUNT), found=(3,), presence=0.7)])  # fmt: skip
def test_a_hand_needs_evidence(hand: MadeHand) -> None:
    """Low presence, the bare table, and a single frame are no hand."""
    found = find(*made_video([hand]))
    assert not found.masks["left"] and not found.masks["right"]


def test_a_third_hand_is_left_out() -> None:
    """Two hands at a time are kept, those with most evidence."""
    hands = [MadeHand(still(60, 130, COUNT), left=True), MadeHand(still(160, 130, COUNT)),
             MadeHand(still(260, 130, COUNT), presence=0.65)]  # fmt: skip
    found = find(*made_video(hands))
    for t in range(COUNT):
        taken = found.masks["left"][t] | found.masks["right"][t]
        assert iou(taken, hands[0].mask(t) | hands[1].mask(t)) > 0.6


def test_stage_with_landmarks() -> None:
    """Key frames and keypoints at working size; the same bytes twice; without landmarks and finder the stage refuses."""
    hand = MadeHand(path((120, 130), (200, 120), COUNT))
    frames, landmarks = made_video([hand])
    one, two = (hand_detect.run(clip_of(frames), frames, hand_detect.Params(), landmarks) for _ in range(2))
    side = int(one.hands.seen[1].all())
    assert one.hands.seen[side].all() and len(one.clip.key_frames) >= 2
    truth = np.stack([hand.points(t) for t in range(COUNT)])
    assert np.abs(one.hands.keypoints_px[side] - truth).max() < 0.01 and (one.hands.confidence[side] > 0.9).all()
    assert CODEC.digest(one.hands) == CODEC.digest(two.hands) and CODEC.digest(one.clip) == CODEC.digest(two.clip)
    with pytest.raises(ValueError, match="there is neither"):
        hand_detect.run(clip_of(frames), frames, hand_detect.Params())


def test_a_hand_is_not_followed_across_a_gap_of_the_video() -> None:
    """Frame numbers that jump are another shot: what was seen before is not expected there."""
    frames, landmarks = made_video([MadeHand(still(120, 130, COUNT), found=(0, 1, 2, 3, 4))])
    jumped = np.where(np.arange(COUNT) < 6, 0, 500)
    cut = replace(frames, frame=frames.frame + jumped, time_ns=frames.time_ns + jumped * 100_000_000)
    found = find(cut, replace(landmarks, frame=cut.frame, time_ns=cut.time_ns))
    seen = {t for side in ("left", "right") for t in found.masks[side]}
    assert {0, 1, 2, 3, 4} <= seen <= {0, 1, 2, 3, 4, 5}


def test_a_bent_wrist_is_estimated() -> None:
    """The direction of the forearm follows from its colours; without a bare forearm the wrist counts as straight."""
    points = MadeHand(still(160, 90, 1)).points(0)
    for turn in (-0.6, 0.0, 0.6):
        odds = np.where(draw_forearm(SIZE_WH[::-1], points, turn, 1.0), 2.0, -2.0).astype(np.float32)
        assert abs(wrist_turn(points, odds) - turn) < 0.25
    assert wrist_turn(points, np.full(SIZE_WH[::-1], -2.0, np.float32)) == 0.0


def test_the_rest_of_a_third_hand_is_dropped() -> None:
    """A hand that is followed to a frame without landmarks, and elsewhere gives way to two with more evidence, is no hand."""
    hands = [MadeHand(still(60, 120, COUNT), left=True, found=tuple(range(1, COUNT))),
             MadeHand(still(160, 120, COUNT), found=tuple(range(1, COUNT))),
             MadeHand(still(260, 120, COUNT), found=(5, 6, 7, 8, 9))]  # fmt: skip
    found = find(*made_video(hands))
    for side in ("left", "right"):
        assert not any(mask[:, 230:].any() for mask in found.masks[side].values())
