"""The real Segment Anything code on a tiny random model: where it is asked, what is kept, and what a stage makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.models.sam import Grid, grid_points, load_model, segment_everything, stability
from afford.surface.proposals import Sam
from stages.surface import mask_propose
from tests.helpers.blocks import changed
from tests.helpers.made_objects import looked
from tests.helpers.tiny_models import save_backbones

ALL = Grid(points=4, least_iou=-9.0, least_stability=0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("tiny")) / "sam"


def test_the_grid_is_the_papers() -> None:
    """i * side / (g + 1): 16 points on 1600 px are 1600 / 17 apart; rows one after the other."""
    points = grid_points(16, 800, 1600)
    assert points.shape == (256, 2) and points[:16, 0] == pytest.approx(np.arange(1, 17) * 1600 / 17)
    assert points[::16, 1] == pytest.approx(np.arange(1, 17) * 800 / 17) and np.ptp(points[:16, 1]) == 0


def test_three_masks_for_each_point_at_the_size_of_the_picture(folder: Path) -> None:
    """Equal masks for any batch of points; a wide picture is not stretched."""
    model, rgb = load_model(str(folder)), np.random.default_rng(0).integers(0, 255, (60, 90, 3), np.uint8)
    points = grid_points(3, 60, 90)
    masks, iou = segment_everything(model, rgb, ALL, points)
    assert masks.shape == (27, 60, 90) and masks.dtype == bool and iou.shape == (27,)
    again, same = segment_everything(model, rgb, replace(ALL, at_once=2), points)
    assert (again == masks).mean() > 0.999 and same == pytest.approx(iou, abs=1e-5)


def test_masks_of_low_iou_or_stability_are_dropped(folder: Path) -> None:
    """Thresholds in the middle keep those above them."""
    model, rgb = load_model(str(folder)), np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    points = grid_points(3, 64, 64)
    _, iou = segment_everything(model, rgb, ALL, points)
    middle = float(np.median(iou))
    _, sure = segment_everything(model, rgb, replace(ALL, least_iou=middle), points)
    assert sorted(sure.tolist()) == pytest.approx(sorted(iou[iou >= middle].tolist()), abs=1e-6) and 0 < len(sure) < len(iou)
    assert not len(segment_everything(model, rgb, replace(ALL, least_stability=1.1), points)[0])


def test_stability_is_the_overlap_of_two_cuts() -> None:
    """Two of four pixels above -1 are above 1."""
    logits = torch.tensor([[[2.0, 3.0], [0.5, -0.5]], [[-5.0, -5.0], [-5.0, -5.0]]])
    assert stability(logits, 1.0).tolist() == [0.5, 0.0]


def test_the_stage_keeps_masks_on_the_object(folder: Path) -> None:
    """No mask is off the object, and no mask is there twice; without a model the error says what is missing."""
    x = looked()
    params = mask_propose.Params("sam", sam=Sam(str(folder), grid=6, least_iou=-9.0, least_stability=0.0, least_px=5))
    found = mask_propose.run(x.mesh, x.views, params)
    for view, mask in zip(found.view, found.masks, strict=True):
        assert not mask[x.views.face[view] < 0].any() and mask.sum() >= 5
    assert (np.diff(found.view) >= 0).all()
    for name, said in (("", "needs a model"), ("/nowhere", "expected a SamModel in a local folder")):
        with pytest.raises(ValueError, match=said):
            mask_propose.run(x.mesh, x.views, changed(params, model=name))
