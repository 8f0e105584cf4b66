"""Laws of motion: what goes along with a hand is told from what rests, whatever the camera does."""

from __future__ import annotations

import numpy as np
import pytest

from afford.extraction.hands.motion import SampledFrames, comotion, residual_speed

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
def test_only_what_moves_by_itself_has_a_motion_of_its_own(camera: float) -> None:
    """In pixels of the half size; at the last look, by where it came from."""
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
