"""Laws of motion beside hands: what goes along with one is told from what rests, whatever the camera does, and is remembered."""

from __future__ import annotations

import numpy as np
import pytest

from afford.extraction.hands.motion import SampledFrames, camera_flow, comotion, propagate_odds

HEIGHT, WIDTH = 96, 128
SMALL = (HEIGHT // 2, WIDTH // 2)


def box(y0: int, y1: int, x0: int, x1: int, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> np.ndarray:
    out = np.zeros(shape, bool)
    out[y0:y1, x0:x1] = True
    return out


HAND, ARM, THING, REST = box(40, 60, 40, 60), box(60, 96, 40, 60), box(30, 70, 60, 80), box(30, 70, 90, 100)


def looks_of(*flows: np.ndarray) -> SampledFrames:
    """As many sampled and one more, joined by these flows (h / 2, w / 2, 2) and by their opposites back."""
    count = len(flows) + 1
    return SampledFrames(np.arange(count), np.zeros((count, HEIGHT, WIDTH, 3), np.uint8), np.arange(count) / 10,
                 [None, *(-flow for flow in flows)], [*flows, None])  # fmt: skip


def flow(camera: tuple[float, float] = (0, 0), **moved: tuple[np.ndarray, tuple[float, float]]) -> np.ndarray:
    out = np.tile(np.float32(camera), (*SMALL, 1))
    for where, by in moved.values():
        out[where[::2, ::2]] += np.float32(by)
    return out


@pytest.mark.parametrize("camera", [(0.0, 0.0), (3.0, -2.0)])
def test_what_goes_along_is_told_from_what_rests(camera: tuple[float, float]) -> None:
    """Also under a camera that pans, by the motion of the hand and not of its arm, which turns."""
    both = HAND | ARM
    along = THING & (np.arange(HEIGHT) < 60)[:, None]
    sampled = looks_of(flow(camera, hand=(HAND, (4, 0)), arm=(ARM, (0, 4)), thing=(along, (4, 0))))
    says = comotion(sampled, 0, both, both, far_px=60.0)
    assert np.median(says[along]) > 0.7 and says[REST].max() < -0.9
    assert says.shape == (HEIGHT, WIDTH) and np.abs(says).max() <= 1


def test_a_hand_that_rests_or_that_nothing_is_known_of_says_nothing() -> None:
    sampled = looks_of(flow(thing=(THING, (4, 0))))
    assert np.abs(comotion(sampled, 0, HAND, HAND, 60.0)).max() < 0.05
    alone = SampledFrames(np.arange(1), np.zeros((1, HEIGHT, WIDTH, 3), np.uint8), np.zeros(1), [None], [None])
    assert not comotion(alone, 0, HAND, HAND, 60.0).any()


def test_nothing_is_said_far_away() -> None:
    sampled = looks_of(flow(hand=(HAND, (4, 0)), thing=(THING, (4, 0))))
    says = comotion(sampled, 0, HAND, HAND, far_px=10.0)
    assert says[:, 72:].any() == 0 and says[45:55, 62:66].min() > 0.5


def test_the_cameras_motion_is_that_of_most_of_the_picture() -> None:
    """An affine map comes back exactly, whatever a fifth of the picture does."""
    y, x = np.mgrid[: SMALL[0], : SMALL[1]].astype(np.float32)
    camera = np.stack([1 + 0.02 * x, -2 + 0.01 * y], -1)
    strange = camera + np.where(box(0, 20, 0, 30, SMALL)[..., None], np.float32(9), 0)
    found = camera_flow(strange, np.ones(SMALL, bool))
    assert np.abs(found - camera).max() < 0.05
    assert not camera_flow(strange, np.zeros(SMALL, bool)).any()


def test_what_was_moved_is_one_while_it_rests() -> None:
    """Evidence of one look lasts before and after it and fades; where it is against a thing, as strong evidence for it stays."""
    sampled = looks_of(*[flow()] * 4)
    odds = [np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(5)]
    odds[2][THING] = 4.0
    kept = propagate_odds(odds, sampled, 0.5)
    assert [float(one[50, 70]) for one in kept] == pytest.approx([1, 2, 4, 2, 1], abs=1e-3)
    assert all(np.array_equal(one, other) for one, other in zip(propagate_odds(odds, sampled, 0.0), odds, strict=True))
    odds[4][THING] = -4.0
    assert propagate_odds(odds, sampled, 0.5)[2][50, 70] == 4.0


def test_evidence_goes_where_things_go() -> None:
    sampled = looks_of(flow(thing=(THING, (5, 0))), flow())
    odds = [np.where(THING, 4.0, 0.0).astype(np.float32), *(np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(2))]
    still = propagate_odds(odds, looks_of(flow(), flow()), 0.5)[1]
    moved = propagate_odds(odds, sampled, 0.5)[1]
    assert still[50, 61] == pytest.approx(2) and moved[50, 76] == pytest.approx(2) and moved[50, 61] == 0
