"""Human hand model: skin, skinning weights, mirroring, postures and finger closing."""

from __future__ import annotations

import numpy as np
import pytest

from afford.synthetic.human_hand.appearance import random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import (
    CLOSED,
    HIGH,
    LOW,
    POSTURES,
    SINK_M,
    close_on,
    link_depths,
    opening_posture,
    posture,
)
from afford.synthetic.human_hand.skin import hand_shape

ELBOW = np.array([0.3, -0.4, 0.1])


def test_left_hand_mirrors_the_right_hand() -> None:
    """The left hand is the right one mirrored in its palm frame."""
    look = random_person(np.random.default_rng(0))
    left, right = HandModel.build("left", look), HandModel.build("right", look)
    angles = posture("relaxed")
    a = left.posed(np.eye(4), angles, ELBOW * [1, -1, 1])
    b = right.posed(np.eye(4), angles, ELBOW)
    np.testing.assert_allclose(a * [1, -1, 1], b, atol=1e-5)


def test_zero_angles_give_the_rest_shape_moved_rigidly() -> None:
    """Zero angles give the rest skin; moving the palm and the elbow together moves every vertex alike."""
    hand = HandModel.build("right", random_person(np.random.default_rng(0)))
    straight = np.array([-0.5, 0.0, -0.016])
    np.testing.assert_allclose(hand.posed(np.eye(4), np.zeros(20), straight), hand_shape().vertices, atol=1e-4)
    T = np.eye(4)
    T[:3, 3] = (0.1, 0.2, 0.3)
    np.testing.assert_allclose(hand.posed(T, np.zeros(20), straight + T[:3, 3]), hand_shape().vertices + T[:3, 3], atol=1e-4)


def test_skin_weights_sum_to_one() -> None:
    """The weights of each vertex are positive and sum to one."""
    weights = hand_shape().weights
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("kind", sorted(CLOSED))
@pytest.mark.parametrize("radius", [0.012, 0.03, 0.045])
def test_fingers_close_until_contact_without_penetration(kind: str, radius: float) -> None:
    """The closed hand touches a rod with at least one finger, and no link is deeper than `SINK_M`."""

    def rod(p: np.ndarray) -> np.ndarray:
        return np.hypot(p[:, 0] - 0.03, p[:, 2] - radius - 0.02) - radius

    angles = close_on(kind, rod)
    depth, start = link_depths(angles, rod), link_depths(opening_posture(kind), rod)
    assert (depth <= np.maximum(start, SINK_M) + 1e-9).all()
    assert depth.max() > -0.004


@pytest.mark.parametrize("kind", sorted(POSTURES))
def test_postures_respect_the_joint_limits(kind: str) -> None:
    """No posture bends a joint beyond its limits."""
    angles = posture(kind)
    assert (angles >= LOW - 1e-9).all() and (angles <= HIGH + 1e-9).all()


def test_skin_mesh_is_closed_except_at_the_elbow() -> None:
    """Edges have two faces, except at the end of the arm behind the elbow."""
    shape = hand_shape()
    edges = np.sort(np.concatenate([shape.faces[:, [0, 1]], shape.faces[:, [1, 2]], shape.faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    open_end = shape.vertices[unique[count == 1]][:, :, 0]
    assert open_end.size == 0 or open_end.max() < -0.4
