"""What the scorer sees of a mask: close by and from afar, and the same when the camera rolls."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from afford.surface.face_features import FaceFeatures
from afford.surface.score.samples import CHANNELS, EVEN, SIZE, MaskCropper, rotate_crops
from afford.surface.score.shape_features import mask_traits
from tests.helpers.made_objects import looked


@cache
def crops() -> np.ndarray:
    """Crops of all candidates of a screwdriver, computed once."""
    x = looked()
    cut = MaskCropper(x.mesh, x.views)
    return np.stack([cut(int(v), m) for v, m in zip(x.candidates.view, x.candidates.masks, strict=True)])


def test_close_by_the_mask_is_large_and_afar_it_is_where_it_was() -> None:
    """Its longer side fills most of the close crop; afar its share is that of the view."""
    x, found = looked(), crops()
    assert found.shape[1:] == (2, len(CHANNELS), SIZE, SIZE) and found.dtype == np.uint8
    for crop, mask, view in zip(found, x.candidates.masks, x.candidates.view, strict=True):
        extent = max(np.ptp(place) + 1 for place in np.nonzero(crop[0, 1]))
        assert 0.5 < extent / SIZE < 0.72
        share = mask.sum() / (x.views.face[view] >= 0).sum()
        assert (crop[1, 1] / 255).sum() / (crop[1, 2] / 255).sum() == pytest.approx(share, abs=0.03)
        assert (crop[:, 1] <= crop[:, 2]).all()  # the mask lies on the object


def test_normals_face_the_camera() -> None:
    """z towards it, so below the middle; nothing beside the object."""
    crop = crops()[:, 1]
    inside, beside = crop[:, 2] == 255, crop[:, 2] == 0
    assert (crop[:, 5][inside] <= EVEN + 1).all() and (crop[:, 5][inside] < EVEN - 60).mean() > 0.5
    assert (np.abs(crop[:, 3:][np.broadcast_to(beside[:, None], crop[:, 3:].shape)].astype(int) - EVEN) <= 1).all()


@pytest.mark.parametrize(("turn", "mirror"), [(1, False), (2, False), (3, True), (0, True)])
def test_a_roll_of_the_camera_is_a_turn_of_the_crop(turn: int, mirror: bool) -> None:
    """Cut from views that were rolled or mirrored, normals and all, crops are those of the views, so turned and no other way."""
    x, flip = looked(), np.diag([-1.0 if mirror else 1.0, 1, 1, 1])
    roll = np.linalg.matrix_power(np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), turn)
    side = slice(None, None, -1 if mirror else 1)
    rgb, face, masks = (np.rot90(a, turn, (1, 2))[:, :, side].copy() for a in (x.views.rgb, x.views.face, x.candidates.masks))
    cut = MaskCropper(x.mesh, replace(x.views, rgb=rgb, face=face, T_obj_cam=x.views.T_obj_cam @ roll @ flip))
    ways, error = [(t, m) for t in range(4) for m in (False, True)], np.zeros(8)
    for view, mask, plain in zip(x.candidates.view[::3], masks[::3], crops()[::3], strict=True):
        error += [np.abs(cut(int(view), mask).astype(int) - rotate_crops(plain, *way)).mean() for way in ways]
    assert ways[error.argmin()] == (turn, mirror) and error.min() < 0.5 * np.median(error)


def test_four_turns_and_two_mirrors_change_nothing() -> None:
    """To the rounding of the normals' middle."""
    plain = crops()[:10]
    again = rotate_crops(rotate_crops(rotate_crops(plain, 1, True), 0, True), 3, False)
    assert np.abs(again.astype(int) - plain).max() <= 1 and np.array_equal(rotate_crops(plain, 0, False), plain)


def test_traits_tell_size_length_and_thickness() -> None:
    """Of a screwdriver: the shaft is thinner than the rest and long; shares are those of the masks."""
    x = looked()
    found = mask_traits(x.views, x.candidates, FaceFeatures.of(x.mesh).thickness)
    part = np.append(x.parts.part, -1)[x.views.face]
    shaft = np.array([(part[v][m] == x.parts.names.index("shaft")).mean() > 0.95 for v, m in
                      zip(x.candidates.view, x.candidates.masks, strict=True)])  # fmt: skip
    assert found.dtype == np.float32 and np.isfinite(found).all() and np.abs(found).max() <= 1.5
    assert found[shaft, 2].max() < 0 and np.median(found[shaft, 1]) > 0.6
    assert np.array_equal(found[:, 3], x.candidates.quality)
