"""A hidden object moves as the hand that holds it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from afford.extraction.layers.shape import PROPAGATED_FIT, holding_hands, propagate_while_held
from afford.extraction.layers.template import PoseTrack
from tests.helpers.toy_clip import texture, toy

SHIFT_PX = 2.0


def sliding_hand(count: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Grey frames (t, h, w) of a textured hand that slides 2 px right a frame, and its masks."""
    picture = texture(np.random.default_rng(1), 60, 60, (120, 120, 120)).mean(axis=2).astype(np.uint8)
    grey, mask = np.full((count, 100, 140), 90, np.uint8), np.zeros((count, 100, 140), bool)
    for t in range(count):
        x = 20 + int(SHIFT_PX * t)
        grey[t, 20:80, x : x + 60], mask[t, 20:80, x : x + 60] = picture, True
    return grey, mask


def known_ends(count: int) -> PoseTrack:
    """Right in the first and the last frame, found in no other."""
    poses = np.tile(np.array([[10.0, 0, 50], [0, 10, 50]]), (count, 1, 1))
    poses[-1, 0, 2] += SHIFT_PX * (count - 1)
    return PoseTrack(poses, np.array([1, *[0] * (count - 2), 1], np.float32))


def ends_visible(mask: np.ndarray) -> np.ndarray:
    visible = np.zeros_like(mask)
    for t in (0, -1):
        visible[t], mask[t, 40:60] = mask[t], False
    return visible & ~mask


def test_a_hidden_object_moves_with_the_hand() -> None:
    """Every pose between is the first one plus the way of the hand, to half a pixel, and counts as carried."""
    grey, hand = sliding_hand()
    visible = ends_visible(hand)
    path = propagate_while_held(known_ends(len(grey)), grey, visible, hand)
    assert np.abs(path.poses[:, 0, 2] - (50 + SHIFT_PX * np.arange(len(grey)))).max() < 0.5
    assert np.allclose(path.poses[:, :, :2], 10 * np.eye(2), atol=0.5)
    assert np.allclose(path.fit[1:-1], PROPAGATED_FIT)


def test_what_no_hand_holds_stays_unknown() -> None:
    """Without a hand nothing carries the object: the path is as it was."""
    grey, hand = sliding_hand()
    visible, before = ends_visible(hand), known_ends(len(grey))
    after = propagate_while_held(before, grey, visible, np.zeros_like(hand))
    assert np.array_equal(after.poses, before.poses)
    assert np.array_equal(after.fit, before.fit)


def test_frames_that_show_the_object_are_kept() -> None:
    """A path with no glimpse in it is not touched, and neither is that of an object never seen."""
    grey, hand = sliding_hand()
    full = PoseTrack(known_ends(len(grey)).poses, np.ones(len(grey), np.float32))
    assert np.array_equal(propagate_while_held(full, grey, hand, hand).poses, full.poses)
    assert propagate_while_held(full, grey, np.zeros_like(hand), hand) is full


def test_holding_is_the_touching_hand_where_it_touches() -> None:
    """Only the right hand of the toy touches the card; a contact taken away takes its pixels away."""
    tracks = toy(count=10).tracks
    assert np.array_equal(holding_hands(tracks, 2), tracks.masks[1])
    contact = tracks.contact.copy()
    contact[:, 5] = -1
    assert not holding_hands(replace(tracks, contact=contact), 2)[5].any()
    assert cv2.countNonZero(holding_hands(tracks, 2)[5].view(np.uint8)) == tracks.masks[1, 5].sum()
