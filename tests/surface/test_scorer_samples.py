"""Inputs of the part scorer: crops, rotation of the camera, and mask traits."""

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


def test_close_and_whole_crops() -> None:
    """Check the size of the mask in the close crop, and its share in the whole view."""
    x, found = looked(), crops()
    assert found.shape[1:] == (2, len(CHANNELS), SIZE, SIZE) and found.dtype == np.uint8
    for crop, mask, view in zip(found, x.candidates.masks, x.candidates.view, strict=True):
        extent = max(np.ptp(place) + 1 for place in np.nonzero(crop[0, 1]))
        assert 0.5 < extent / SIZE < 0.72
        share = mask.sum() / (x.views.face[view] >= 0).sum()
        assert (crop[1, 1] / 255).sum() / (crop[1, 2] / 255).sum() == pytest.approx(share, abs=0.03)
        assert (crop[:, 1] <= crop[:, 2]).all()  # the mask lies on the object


def test_normals_face_the_camera() -> None:
    """Check z towards the camera, and no normal in the background."""
    crop = crops()[:, 1]
    inside, beside = crop[:, 2] == 255, crop[:, 2] == 0
    assert (crop[:, 5][inside] <= EVEN + 1).all() and (crop[:, 5][inside] < EVEN - 60).mean() > 0.5
    assert (np.abs(crop[:, 3:][np.broadcast_to(beside[:, None], crop[:, 3:].shape)].astype(int) - EVEN) <= 1).all()


@pytest.mark.parametrize(("turn", "mirror"), [(1, False), (2, False), (3, True), (0, True)])
def test_camera_roll_equals_crop_rotation(turn: int, mirror: bool) -> None:
    """Check that crops of rolled or mirrored views match exactly one rotation of the crops."""
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
    """Check equality to the rounding of the normals."""
    plain = crops()[:10]
    again = rotate_crops(rotate_crops(rotate_crops(plain, 1, True), 0, True), 3, False)
    assert np.abs(again.astype(int) - plain).max() <= 1 and np.array_equal(rotate_crops(plain, 0, False), plain)


def test_traits_measure_size_length_and_thickness() -> None:
    """Check a screwdriver, whose shaft is thin and long."""
    x = looked()
    found = mask_traits(x.views, x.candidates, FaceFeatures.of(x.mesh).thickness)
    part = np.append(x.parts.part, -1)[x.views.face]
    shaft = np.array([(part[v][m] == x.parts.names.index("shaft")).mean() > 0.95 for v, m in
                      zip(x.candidates.view, x.candidates.masks, strict=True)])  # fmt: skip
    assert found.dtype == np.float32 and np.isfinite(found).all() and np.abs(found).max() <= 1.5
    assert found[shaft, 2].max() < 0 and np.median(found[shaft, 1]) > 0.6
    assert np.array_equal(found[:, 3], x.candidates.quality)
