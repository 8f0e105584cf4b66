"""Sums of end-point errors: none for the truth itself, by hand for a known miss, adding up over sequences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.rgbd.scene_flow.metrics import flow_figures
from schemas.interaction import InteractionTruth, SceneFlow
from stages.rgbd import scene_flow_score

PARAMS = scene_flow_score.Params()


def truth(name: str = "a") -> InteractionTruth:
    """Two pairs of 4 x 4; the left half moves by 0.01 m and 2 px to the right; the last row has no surface."""
    on_image = np.zeros((2, 4, 4, 2), np.float32)
    on_image[:, :, :2, 0] = 2
    flow = np.zeros((2, 4, 4, 3), np.float32)
    flow[:, :, :2, 0] = 0.01
    valid = np.ones((2, 4, 4), bool)
    valid[:, 3] = False
    return InteractionTruth(name, flow, on_image, valid, valid, np.ones((3, 4, 4), np.float32))


def flow(of: InteractionTruth, more_m: float, more_px: float = 0.0) -> SceneFlow:
    """The truth and so much more along z, and downwards on the image; nonsense where there is no surface."""
    found, on_image = of.flow_m.copy(), of.flow_px.copy()
    found[..., 2] += more_m
    on_image[..., 1] += more_px
    found[~of.valid], on_image[~of.valid] = 9, 9
    grey = np.zeros(found.shape, np.uint8)
    return SceneFlow(of.name, found.astype(np.float16), on_image.astype(np.float16), grey, grey, np.zeros(6, np.uint8))


def test_errors_are_summed_over_known_pixels() -> None:
    """A quarter of a centimetre of 24 pixels, 12 of which move; the truth itself misses by rounding alone."""
    told = truth()
    found = scene_flow_score.run(flow(told, 0.0), flow(told, 0.0025), told, PARAMS)
    assert (found.pixels, found.moving) == (24, 12) and found.error_m < 24 * 1e-5
    assert found.plain_m == pytest.approx(24 * 0.0025, rel=1e-3) and found.plain_moving_m == pytest.approx(12 * 0.0025, rel=1e-3)


def test_sequences_add_up() -> None:
    """The ratio of a set is that of its sums; a sequence without a surface changes nothing."""
    told, blind = truth(), replace(truth("b"), valid=np.zeros((2, 4, 4), bool))
    one = scene_flow_score.run(flow(told, 0.0025), flow(told, 0.01), told, PARAMS)
    none = scene_flow_score.run(flow(blind, 1), flow(blind, 1), blind, PARAMS)
    assert flow_figures([one]) == flow_figures([one, none])
    assert flow_figures([one])["flow.epe_ratio"] == pytest.approx(0.25, rel=1e-2)
    twice = flow_figures([one, replace(one, error_m=3 * one.error_m)])
    assert twice["flow.epe_ratio"] == pytest.approx(2 * flow_figures([one])["flow.epe_ratio"])
    assert flow_figures([none]) == flow_figures([]) == {}


def test_motion_on_the_image_is_measured_too() -> None:
    """Half a pixel against two and a half over every pixel with a surface; moving pixels are those that move in space."""
    told = truth()
    found = scene_flow_score.run(flow(told, 0.0, 0.5), flow(told, 0.0, 2.5), told, PARAMS)
    assert (found.error_px, found.error_moving_px, found.plain_px, found.plain_moving_px) == (12, 6, 60, 30)
    numbers = flow_figures([found, found])
    assert (numbers["flow.epe_px"], numbers["flow.epe_px_moving"]) == (0.5, 0.5)
    assert (numbers["flow.difference_epe_px"], numbers["flow.difference_epe_px_moving"]) == (2.5, 2.5)
    still = scene_flow_score.run(flow(told, 0.0, 0.5), flow(told, 0.0, 2.5), replace(told, flow_m=0 * told.flow_m), PARAMS)
    assert flow_figures([still]).keys() & {"flow.epe_px", "flow.epe_px_moving"} == {"flow.epe_px"} and still.error_moving_px == 0


def test_a_flow_of_another_sequence_is_refused() -> None:
    """One sentence."""
    with pytest.raises(ValueError, match="a: expected two scene flows of this sequence"):
        scene_flow_score.run(flow(truth("b"), 0.0), flow(truth(), 0.0), truth(), PARAMS)
