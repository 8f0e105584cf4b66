"""Baselines of negative affordance: windows, relevance of pixels, coarse boxes and the masks in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.common.masks import box
from afford.render.views.plan import SIX
from afford.surface.negative import baselines
from afford.surface.negative.baselines import box_iou, coarse_box, mask_in_box, relevance
from afford.surface.negative.project import split_by_task
from afford.surface.proposals.grid import windows
from schemas.surface import PartCandidates, PartScores
from tests.helpers.blocks import changed
from tests.helpers.made_objects import GRID, looked, true_scores
from tests.surface.test_negative_project import description


def blob(seed: int) -> np.ndarray:
    """Draw a disc or a bar at a random position: (h, w) bool."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:60, :90]
    cy, cx = rng.uniform(15, 45), rng.uniform(15, 75)
    return np.asarray(np.hypot((y - cy) * rng.uniform(1, 8), x - cx) < rng.uniform(5, 40))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("count", [1, 2, 6, 9])
def test_windows_cover_the_silhouette_and_nothing_else(seed: int, count: int) -> None:
    """Check that windows are inside it and inside a square, and that no pixel is in more than four."""
    on = blob(seed)
    found = windows(on, count)
    assert found.shape == (count**2, *on.shape) and not found[:, ~on].any() and found.any(0)[on].all() and found.sum(0).max() <= 4
    width = max(side.stop - side.start for side in box(on))
    for one in found:
        assert max(side.stop - side.start for side in box(one)) <= np.ceil(2 * width / (count + 1))


def test_windows_of_a_square_overlap_by_half() -> None:
    """Check three windows along 8 px: 4 px wide, 2 px apart."""
    on = np.zeros((12, 12), bool)
    on[2:10, 3:11] = True
    corners = [tuple(side.start for side in box(one)) for one in windows(on, 3)]
    assert corners == [(y, x) for y in (2, 4, 6) for x in (3, 5, 7)] and windows(on, 3).sum((1, 2)).tolist() == [16] * 9


def test_stage_skips_nearly_empty_windows() -> None:
    """Check six views, the least share, distinct windows, and the error without a window."""
    x = looked("pan")
    found = x.windows()
    assert sorted(set(found.view.tolist())) == list(range(SIX)) and len(x.views.face) > SIX
    for view, mask in zip(found.view, found.masks, strict=True):
        on = x.views.face[view] >= 0
        assert not mask[~on].any() and mask.sum() >= GRID.grid.least_window * on.sum()
    assert len({(view, mask.tobytes()) for view, mask in zip(found.view.tolist(), found.masks, strict=True)}) == len(found.view)
    few, every = (x.windows(changed(GRID, least_window=share)) for share in (0.2, 0.0))
    assert len(few.view) < len(found.view) < len(every.view)
    with pytest.raises(ValueError, match=r"mask_propose.grid.windows: expected 1 or more"):
        x.windows(changed(GRID, windows=0))


def test_equal_fits_give_equal_relevance() -> None:
    """Check that the mean of equal values is independent of the number of windows."""
    x = looked()
    found = x.windows()
    share = np.tile(np.array([0.6, 0.2], np.float32), (len(found.view), 1))
    value, count = relevance(found, PartScores("x", share, share), description("negative", "positive"), x.views.face.shape)
    assert value[count > 0] == pytest.approx(0.6**1.5 / (0.6**1.5 + 0.2**1.5)) and not value[count == 0].any()
    assert np.array_equal(count.astype(int), [found.masks[found.view == view].sum(0) for view in range(len(count))])


def test_windows_without_fit_have_no_relevance() -> None:
    """Check that they are counted, and that a description without notes has no relevance."""
    masks = np.ones((2, 1, 3), bool)
    masks[1, 0, 0] = False
    found = PartCandidates("x", np.zeros(2, np.int16), masks, np.zeros(2, np.float32))
    share = np.array([[0.9, 0.0], [0.01, 0.0]], np.float32)
    value, count = relevance(found, PartScores("x", share, share), description("negative", "positive"), (1, 1, 3))
    assert value[0, 0] == pytest.approx([1.0, 0.5, 0.5]) and count[0, 0].tolist() == [1, 2, 2]
    none = np.zeros((2, 0), np.float32)
    assert not relevance(found, PartScores("x", none, none), description(), (1, 1, 3))[0].any()


def test_relevance_by_true_fits() -> None:
    """Check a screwdriver: most of the shaft, little of the handle's far end."""
    x = looked()
    found, use = x.windows(), x.told.descriptions[0]
    mine = next(split_by_task(x.told, true_scores(x, found)))[1]
    said = baselines.clip_relevance(x.mesh, x.views, found, use, mine)
    negative = [n.part for n in use.notes if n.role == "negative"]
    true, area = np.isin(x.parts.part, [x.parts.names.index(name) for name in negative]), x.views.visible_area
    iou = area[said & true].sum() / area[said | true].sum()
    assert 0.6 < iou < 1
    empty = np.zeros((len(found.view), 0), np.float32)
    assert not baselines.clip_relevance(x.mesh, x.views, found, replace(use, notes=()), PartScores("x", empty, empty)).any()


@pytest.mark.parametrize("seed", range(10))
def test_box_contains_the_best_windows(seed: int) -> None:
    """Check windows with nearly the best fit, and a single window."""
    found = windows(blob(seed), 4)
    found = found[found.any((1, 2))]
    fit = np.random.default_rng(seed).random(len(found))
    asked = coarse_box(found, fit)
    for one in found[fit >= 0.9 * fit.max()]:
        assert one[asked].sum() == one.sum()
    alone = np.where(np.arange(len(found)) == fit.argmax(), 1.0, 0.1)
    assert coarse_box(found, alone) == box(found[fit.argmax()])


def test_mask_that_fills_the_box_is_selected() -> None:
    """Check two halves, the silhouette for a full box, and the silhouette alone."""
    on = np.zeros((6, 10), bool)
    on[1:5] = True
    halves = np.stack([on, on])
    halves[0, :, 5:], halves[1, :, :5] = False, False
    for n, asked in enumerate((np.s_[1:5, 0:6], np.s_[0:4, 5:10])):
        assert np.array_equal(mask_in_box(asked, halves, on), halves[n])
    assert np.array_equal(mask_in_box(np.s_[0:6, 1:10], halves, on), on)
    assert np.array_equal(mask_in_box(np.s_[1:3, 1:3], halves[:0], on), on)
    assert box_iou(np.s_[0:2, 0:4], np.s_[1:3, 0:4]) == pytest.approx(1 / 3) and box_iou(np.s_[0:1, 0:1], np.s_[2:3, 2:3]) == 0


def test_share_of_whole_object_masks() -> None:
    """Check 1 for silhouettes, 0 for halves, NaN without masks."""
    x, use = looked(), looked().told.descriptions[0]
    found = x.windows()
    none = replace(x.candidates, view=x.candidates.view[:0], masks=x.candidates.masks[:0], quality=x.candidates.quality[:0])
    taken = baselines.coarse_box_recipe(x.views, none, found, use, true_scores(x, found))
    assert len(taken) == SIX and baselines.whole_object_taken(x.views, taken) == 1
    assert baselines.splat_masks(x.mesh, x.views, taken).mean() > 0.8
    half = [on & (np.cumsum(on).reshape(on.shape) * 2 < on.sum()) for on in x.views.face[:2] >= 0]
    assert baselines.whole_object_taken(x.views, [half[0], None, taken[2], taken[3]]) == pytest.approx(2 / 3)
    assert np.isnan(baselines.whole_object_taken(x.views, [None] * SIX))
    assert baselines.coarse_box_recipe(x.views, x.candidates, found, replace(use, notes=()), true_scores(x, found)) == [None] * SIX


def test_baselines_depend_on_their_inputs_alone() -> None:
    """Check determinism, and that views beyond the six change nothing."""
    x, use = looked("pan"), looked("pan").told.descriptions[0]
    found = x.windows()
    said = true_scores(x, found)
    first = [baselines.coarse_box_recipe(x.views, x.candidates, found, use, said) for _ in range(2)]
    assert all(np.array_equal(a, b) for a, b in zip(*first, strict=True))  # type: ignore[arg-type]  # a mask in every view
    face = x.views.face.copy()
    face[SIX:] = -1
    blind = replace(x.views, face=face)
    mine = next(split_by_task(x.told, said))[1]
    assert np.array_equal(*(baselines.clip_relevance(x.mesh, views, found, use, mine) for views in (x.views, blind)))
