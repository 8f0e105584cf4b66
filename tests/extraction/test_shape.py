"""What no frame has seen is bridged from rim to rim, and nowhere else."""

from __future__ import annotations

import numpy as np

from afford.extraction.layers.shape import BRIDGE_CONFIDENCE, bridge, complete_shape
from afford.extraction.layers.template import PoseTrack


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


def test_nothing_is_guessed_outside_the_unknown() -> None:
    """In a lone frame the handle is bridged where `unknown` allows; elsewhere it stays as it is seen, in little trust."""
    bar, head, finger = crossed_bar()
    visible, path = ((bar | head) & ~finger)[None], PoseTrack(np.eye(2, 3)[None], np.zeros(1, np.float32))
    complete, confidence = complete_shape(path, np.array([1]), visible, finger[None], np.zeros_like(finger)[None])
    assert np.array_equal(complete, visible)
    complete, confidence = complete_shape(path, np.array([1]), visible, finger[None], finger[None])
    assert np.array_equal(complete[0], bar | head)
    assert confidence[0] == BRIDGE_CONFIDENCE
