"""Motion with a hand, and speed relative to the background, under camera motion."""

from __future__ import annotations

import numpy as np
import pytest

from afford.extraction.hands.motion import SampledFrames, camera_flow, comotion, propagate_odds, residual_speed

HEIGHT, WIDTH = 96, 128
SMALL = (HEIGHT // 2, WIDTH // 2)


def rectangle(y0: int, y1: int, x0: int, x1: int, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> np.ndarray:
    out = np.zeros(shape, bool)
    out[y0:y1, x0:x1] = True
    return out


HAND, ARM, THING, REST = rectangle(40, 60, 40, 60), rectangle(60, 96, 40, 60), rectangle(30, 70, 60, 80), rectangle(30, 70, 90, 100)


def looks_of(*flows: np.ndarray) -> SampledFrames:
    """Build sampled frames, one more than flows, connected by these flows (h / 2, w / 2, 2) and their opposites."""
    count = len(flows) + 1
    return SampledFrames(np.arange(count), np.zeros((count, HEIGHT, WIDTH, 3), np.uint8), np.arange(count) / 10,
                 [None, *(-flow for flow in flows)], [*flows, None])  # fmt: skip


def flow(camera: tuple[float, float] = (0, 0), **moved: tuple[np.ndarray, tuple[float, float]]) -> np.ndarray:
    out = np.tile(np.float32(camera), (*SMALL, 1))
    for where, by in moved.values():
        out[where[::2, ::2]] += np.float32(by)
    return out


@pytest.mark.parametrize("camera", [(0.0, 0.0), (3.0, -2.0)])
def test_comotion_separates_moving_objects_from_background(camera: tuple[float, float]) -> None:
    """The camera may pan; the motion of the hand counts, not that of its rotating arm."""
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


def test_comotion_is_zero_far_from_the_hand() -> None:
    """Pixels beyond `far_px` of the hand score 0."""
    sampled = looks_of(flow(hand=(HAND, (4, 0)), thing=(THING, (4, 0))))
    says = comotion(sampled, 0, HAND, HAND, far_px=10.0)
    assert says[:, 72:].any() == 0 and says[45:55, 62:66].min() > 0.5


def test_the_cameras_motion_is_that_of_most_of_the_picture() -> None:
    """An affine map comes back exactly, whatever a fifth of the picture does."""
    y, x = np.mgrid[: SMALL[0], : SMALL[1]].astype(np.float32)
    camera = np.stack([1 + 0.02 * x, -2 + 0.01 * y], -1)
    strange = camera + np.where(rectangle(0, 20, 0, 30, SMALL)[..., None], np.float32(9), 0)
    found = camera_flow(strange, np.ones(SMALL, bool))
    assert np.abs(found - camera).max() < 0.05
    assert not camera_flow(strange, np.zeros(SMALL, bool)).any()


def test_odds_are_propagated_while_an_object_rests() -> None:
    """Odds of one sampled frame decay before and after it; strong odds outweigh contrary ones."""
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


SIZE = (80, 160)


def box(x: int, y: int, side: int = 16) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask[y : y + side, x : x + side] = True
    return mask


def sampled(moving: np.ndarray, by: tuple[float, float], camera: float) -> SampledFrames:
    """Two sampled frames: masked pixels move by `by` (px of the half size), all others with the camera, which also rotates."""
    x = np.linspace(0, 1, SIZE[1] // 2, dtype=np.float32)
    flow = np.stack([camera * (1 + x), 0 * x], -1)[None].repeat(SIZE[0] // 2, 0)
    flow[moving[::2, ::2]] += np.array(by, np.float32)
    return SampledFrames(np.arange(2), np.zeros((2, *SIZE, 3), np.uint8), np.arange(2) / 10, [None, -flow], [flow, None])


@pytest.mark.parametrize("camera", [0.0, 3.0])
def test_residual_speed_ignores_camera_motion(camera: float) -> None:
    """Speed is in pixels of the half size; the last sampled frame uses the flow to the previous one."""
    seen = sampled(box(20, 20), (4.0, 0.0), camera)
    for k in (0, 1):
        speed = residual_speed(seen, k)
        assert speed.shape == SIZE and np.median(speed[box(20, 20)]) == pytest.approx(4, abs=0.4)
        assert np.median(speed[~box(16, 16, 24)]) < 0.2
    assert not residual_speed(SampledFrames(seen.at[:1], seen.rgb[:1], seen.time_s[:1], [None], [None]), 0).any()


@pytest.mark.parametrize("camera", [0.0, 3.0])
def test_a_thing_goes_along_with_the_hand_beside_it(camera: float) -> None:
    """The background speaks against it; what is far says nothing."""
    hand, thing, far = box(20, 20), box(36, 20), box(130, 20)
    says = comotion(sampled(hand | thing | far, (4.0, 1.0), camera), 0, hand, hand, 40)
    assert says[thing].mean() > 0.6 and says[box(20, 44)].mean() < -0.6 and not says[far].any()
