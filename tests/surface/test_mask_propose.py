"""Stage mask_propose: masks are on the object, distinct, and contain the geometric parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates
from stages.surface import mask_propose, view_render
from tests.helpers.made_meshes import as_object, ball
from tests.surface.test_proposal_regions import dumbbell

Shown = tuple[ObjectMesh, ObjectViews, PartCandidates]


@pytest.fixture(scope="module")
def shown() -> Shown:
    thing = as_object(dumbbell())
    views = view_render.run(thing, view_render.Params(size_px=128, directions=64))
    return thing, views, mask_propose.run(thing, views, mask_propose.Params())


def test_masks_are_on_the_object(shown: Shown) -> None:
    """Check that masks are neither empty nor the whole object."""
    _, views, found = shown
    for view, mask in zip(found.view, found.masks, strict=True):
        on = views.face[view] >= 0
        assert not mask[~on].any() and 60 <= mask.sum() <= 0.95 * on.sum()
    assert (np.diff(found.view) >= 0).all()


def test_masks_of_a_view_are_distinct(shown: Shown) -> None:
    """Check an IoU of at most 0.7, and the order by quality."""
    _, _, found = shown
    for view in np.unique(found.view):
        mine = found.masks[found.view == view]
        assert (np.diff(found.quality[found.view == view]) <= 0).all()
        for i in range(len(mine)):
            assert all((mine[i] & mine[j]).sum() <= 0.7 * (mine[i] | mine[j]).sum() for j in range(i))


def test_visible_block_is_proposed(shown: Shown) -> None:
    """Check an IoU above 0.9 in each view."""
    thing, views, found = shown
    block = thing.vertices[thing.faces].mean(1)[:, 1] > 0.0799
    for view, face in enumerate(views.face):
        truth = np.append(block, False)[face]
        if truth.sum() >= 60 and truth.sum() < 0.9 * (face >= 0).sum():
            overlaps = [(m & truth).sum() / (m | truth).sum() for m in found.masks[found.view == view]]
            assert max(overlaps) > 0.9, views.views[view]


def test_views_of_another_mesh_are_refused(shown: Shown) -> None:
    """Check that the error names both."""
    _, views, _ = shown
    with pytest.raises(ValueError, match="render the views again"):
        mask_propose.run(as_object(ball(0.1, 1)), views, mask_propose.Params())


def test_unknown_backend_lists_the_known_ones(shown: Shown) -> None:
    """Check the error of the registry."""
    thing, views, _ = shown
    with pytest.raises(KeyError, match="regions"):
        mask_propose.run(thing, views, replace(mask_propose.Params(), backend="other"))
