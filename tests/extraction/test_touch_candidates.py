"""Laws of the candidates for a touched object, on drawn hands and a segmentation that is drawn too."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.extraction.hands.touch_candidates import FEATURES, POINTS, Grip, prompts, touch_candidates
from afford.extraction.hands.touch_ranker import WEIGHTS, touch_scores
from afford.extraction.prompted import AtPoint, Outlines

HEIGHT, WIDTH = 96, 160
Y, X = np.mgrid[:HEIGHT, :WIDTH]
HAND = (abs(X - 60) < 10) & (abs(Y - 60) < 12)
CUP, TABLE, SPECK = (abs(X - 82) < 14) & (abs(Y - 56) < 10), Y > 20, (abs(X - 74) < 2) & (abs(Y - 60) < 2)
NOTHING = np.zeros((HEIGHT, WIDTH), np.float32)


def grip(hand: np.ndarray = HAND, others: np.ndarray | None = None) -> Grip:
    """A hand without keypoints, arms, motion or evidence."""
    return Grip(hand, hand if others is None else hand | others, NOTHING > 0, None, NOTHING, NOTHING)


def drawn(*masks: np.ndarray) -> AtPoint:
    """Segmentation that returns the masks around a point, and noise where it lies in none."""
    def at(point: tuple[float, float]) -> Outlines:
        x, y = round(point[0]), round(point[1])
        return Outlines(np.stack([np.where(mask & mask[y, x], 5.0, -5.0).astype(np.float32) for mask in masks]),
                        np.linspace(0.9, 0.8, len(masks)).astype(np.float32))  # fmt: skip
    return at


def test_points_lie_beside_the_hand_and_in_no_hand() -> None:
    """Spread around the hand, none in it or in the other one, the same on every call."""
    other = (abs(X - 60) < 10) & (abs(Y - 36) < 10)
    held = grip(others=other)
    points = prompts(held, held.ring())
    assert len(points) == len(set(points)) == POINTS and points == prompts(held, held.ring())
    away = cv2.distanceTransform((~HAND).astype(np.uint8), cv2.DIST_L2, 3)
    for x, y in points:
        assert not (HAND | other)[int(y), int(x)] and away[int(y), int(x)] < 12


def test_a_hand_that_fills_the_picture_has_no_points() -> None:
    """No free pixel beside it, so nothing is segmented, and no candidate exists."""
    full = grip(NOTHING == 0)
    found = touch_candidates(drawn(CUP), full)
    assert prompts(full, full.ring()) == []
    assert found.masks.shape == (0, HEIGHT, WIDTH) and found.features.shape == (0, len(FEATURES))


def test_candidates_are_at_the_fingers_and_without_hands() -> None:
    """A cup beside the hand is one candidate however many points hit it; a speck and what fills the picture are none."""
    found = touch_candidates(drawn(CUP | HAND, TABLE, SPECK), grip())
    assert len(found.masks) == 1 and not (found.masks & HAND).any() and np.array_equal(found.masks[0], CUP & ~HAND)


def test_an_object_away_from_the_hand_is_no_candidate() -> None:
    """No point beside the fingers hits it."""
    assert len(touch_candidates(drawn((abs(X - 140) < 12) & (abs(Y - 20) < 10)), grip()).masks) == 0


@pytest.mark.parametrize(("feature", "more"), [("along", {"along": NOTHING + 1}), ("unexplained", {"odds": NOTHING + 3})])
def test_evidence_around_the_hand_becomes_a_feature(feature: str, more: dict[str, np.ndarray]) -> None:
    """Motion and log odds raise the feature of their own, and no feature of shape."""
    plain = grip()
    given = Grip(**{name: more.get(name, getattr(plain, name)) for name in ("hand", "hands", "arms", "points", "odds", "along")})
    before, after = (touch_candidates(drawn(CUP), one).features[0] for one in (plain, given))
    assert after[FEATURES.index(feature)] > before[FEATURES.index(feature)]
    shape = [i for i, name in enumerate(FEATURES) if name in ("size", "distance", "hand inside hull", "quality")]
    assert np.array_equal(before[shape], after[shape])


def test_scores_follow_the_weights() -> None:
    """One weight for every feature; what moves along with the hand is more likely touched, what reaches far away less."""
    assert tuple(WEIGHTS) == FEATURES
    plain = np.zeros((3, len(FEATURES)), np.float32)
    plain[1, FEATURES.index("along")] = plain[2, FEATURES.index("far")] = 1.0
    usual, along, far = touch_scores(plain)
    assert along > usual > far
