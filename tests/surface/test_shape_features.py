"""Shape features of candidates: invariance, and agreement with words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from afford.surface.face_features import FaceFeatures
from afford.surface.score.samples import part_targets
from afford.surface.score.shape_features import SHAPE_FEATURES, shape_features
from tests.helpers.made_objects import looked


def test_features_are_invariant_to_pose_and_scale() -> None:
    """Check the same faces rotated, moved and scaled by three."""
    x = looked()
    features = FaceFeatures.of(x.mesh)
    turn = Rotation.from_euler("xyz", (0.3, -1.1, 2.0)).as_matrix()
    moved = FaceFeatures(3 * features.middle @ turn.T + (1, 2, 3), features.normal @ turn.T, 9 * features.area, features.colour,
                     3 * features.thickness)  # fmt: skip
    found = shape_features(features, x.views, x.candidates)
    again = shape_features(moved, replace(x.views, visible_area=9 * x.views.visible_area), x.candidates)
    assert found.shape == (len(x.candidates.view), len(SHAPE_FEATURES)) and np.isfinite(found).all() and np.abs(found).max() <= 2
    np.testing.assert_allclose(found, again, atol=2e-4)


def test_features_agree_with_words() -> None:
    """Check shaft, handle and tip of a screwdriver."""
    x = looked()
    share, _ = part_targets(x.parts, x.views, x.candidates)
    found = dict(zip(SHAPE_FEATURES, shape_features(FaceFeatures.of(x.mesh), x.views, x.candidates).T, strict=True))
    handle, shaft, tip = (share[:, x.parts.names.index(name)] > 0.9 for name in ("handle", "shaft", "tip"))
    assert found["thickness"][shaft].mean() < found["thickness"][handle].mean()
    assert found["length"][handle].max() > found["length"][tip].max() and found["area"][handle].max() > found["area"][tip].max()
    assert found["nearer_end"][tip].max() < 0.05 < found["farther_end"][tip].min()
    assert found["along"][handle].max() > 0.99
