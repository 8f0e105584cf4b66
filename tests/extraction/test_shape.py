"""Bridging of pixels that no frame shows, from rim to rim inside `unknown` only."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from afford.extraction.layers.shape import (
    BRIDGE_CONFIDENCE,
    PROPAGATED_FIT,
    bridge,
    complete_shape,
    holding_hands,
    propagate_while_held,
)
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
    """Poses between two visible frames follow the motion of the hand to half a pixel, with the fit of a propagated pose."""
    grey, hand = sliding_hand()
    visible = ends_visible(hand)
    path = propagate_while_held(known_ends(len(grey)), grey, visible, hand)
    assert np.abs(path.poses[:, 0, 2] - (50 + SHIFT_PX * np.arange(len(grey)))).max() < 0.5
    assert np.allclose(path.poses[:, :, :2], 10 * np.eye(2), atol=0.5)
    assert np.allclose(path.fit[1:-1], PROPAGATED_FIT)


def test_poses_without_a_hand_are_unchanged() -> None:
    """An object that no hand holds keeps its poses."""
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


def test_holding_hands_are_the_touching_hands() -> None:
    """The right hand of the toy touches the card; frames without contact have no pixels of it."""
    tracks = toy(count=10).tracks
    assert np.array_equal(holding_hands(tracks, 2), tracks.masks[1])
    contact = tracks.contact.copy()
    contact[:, 5] = -1
    assert not holding_hands(replace(tracks, contact=contact), 2)[5].any()
    assert cv2.countNonZero(holding_hands(tracks, 2)[5].view(np.uint8)) == tracks.masks[1, 5].sum()


def crossed_bar() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A horizontal bar, a wide head at its end, and a finger across the bar: (60, 100) bool each; bar without the finger."""
    bar, head, finger = (np.zeros((60, 100), bool) for _ in range(3))
    bar[27:33, 5:70], head[10:50, 70:90], finger[15:45, 30:42] = True, True, True
    return bar, head, finger


def test_a_finger_over_a_handle_is_bridged_by_the_handle_alone() -> None:
    """The head makes the hull of the whole far wider than the handle; the bridge is as wide as the handle."""
    bar, head, finger = crossed_bar()
    assert np.array_equal(bridge((bar | head) & ~finger, finger), bar & finger)


def test_a_hidden_end_is_not_bridged() -> None:
    """A region that meets the shape on one side only gets nothing."""
    bar, _, _ = crossed_bar()
    end = np.zeros_like(bar)
    end[20:40, :20] = True
    assert not bridge(bar & ~end, end).any()


def test_bridging_is_restricted_to_unknown_pixels() -> None:
    """A single frame bridges the handle where `unknown` allows it; elsewhere the mask is the visible one."""
    bar, head, finger = crossed_bar()
    visible, path = ((bar | head) & ~finger)[None], PoseTrack(np.eye(2, 3)[None], np.zeros(1, np.float32))
    complete, confidence = complete_shape(path, np.array([1]), visible, finger[None], np.zeros_like(finger)[None])
    assert np.array_equal(complete, visible)
    complete, confidence = complete_shape(path, np.array([1]), visible, finger[None], finger[None])
    assert np.array_equal(complete[0], bar | head)
    assert confidence[0] == BRIDGE_CONFIDENCE
