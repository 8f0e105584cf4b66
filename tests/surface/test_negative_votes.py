"""Votes on faces equal what is true of them, on shapes where the truth is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from afford.surface.negative.project import cos_incidence, vote_on_faces
from schemas.mesh import ObjectMesh, ObjectViews
from stages.surface import view_render
from tests.helpers.made_meshes import as_object, ball, ring, slotted

SHAPES = {"ball": ball, "ring": ring, "slotted": slotted}
SMALL = view_render.Params(size_px=192, directions=128)


def truth_of(middle: np.ndarray) -> np.ndarray:
    """A part of space: beyond a slanted plane."""
    return np.asarray(middle @ [0.6, 0.3, 0.74] > 0.01)


@pytest.fixture(scope="module", params=SHAPES.values(), ids=SHAPES)
def seen(request: pytest.FixtureRequest) -> tuple[ObjectMesh, ObjectViews]:
    thing = as_object(request.param())
    return thing, view_render.run(thing, SMALL)


def test_a_part_painted_on_the_views_comes_back_on_the_surface(seen: tuple[ObjectMesh, ObjectViews]) -> None:
    """Exact: every face that a pixel shows has its own truth, none that of another (no splatting, no bleeding at outlines)."""
    thing, views = seen
    truth = truth_of(thing.vertices[thing.faces].mean(1))
    painted = np.append(truth, False)[views.face].astype(np.float32)
    probability, evidence = vote_on_faces(views.face, painted, cos_incidence(thing, views), len(thing.faces))
    known = evidence > 0
    assert np.array_equal(probability[known], truth[known].astype(np.float32)) and 0 < truth[known].mean() < 1
    assert views.visible_area[known].sum() / views.visible_area.sum() > 0.97


def test_squareness_is_the_cosine_of_the_angle(seen: tuple[ObjectMesh, ObjectViews]) -> None:
    """Between 0 and 1, 0 beside the object; from positions that depth gives it is the same."""
    thing, views = seen
    cosine = cos_incidence(thing, views)
    assert cosine.min() >= 0 and cosine.max() <= 1 + 1e-6 and not cosine[views.face < 0].any()
    n = len(views.face) - 1
    y, x = (place[::97] for place in np.nonzero(views.face[n] >= 0))
    K, T = views.K[n], views.T_obj_cam[n]
    z = views.depth_m[n, y, x].astype(float)
    place = np.stack([(x - K[0, 2]) / K[0, 0] * z, (y - K[1, 2]) / K[1, 1] * z, z], 1) @ T[:3, :3].T + T[:3, 3]
    to_eye = T[:3, 3] - place
    corner = thing.vertices[thing.faces[views.face[n, y, x]]].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    expected = (to_eye * normal).sum(1) / np.linalg.norm(to_eye, axis=1) / np.linalg.norm(normal, axis=1)
    assert cosine[n, y, x] == pytest.approx(expected, abs=1e-3)


def test_votes_are_weighted_means() -> None:
    """By hand: a face with pixels of 1 (weight 3) and 0 (weight 1) is at 0.75; weight 0 does not count; nobody's face is 0."""
    face = np.array([[[0, 0, 1, -1]]], np.int32)
    value = np.array([[[1.0, 0.0, 1.0, 1.0]]], np.float32)
    probability, evidence = vote_on_faces(face, value, np.array([[[3.0, 1.0, 0.0, 5.0]]], np.float32), 3)
    assert probability.tolist() == [0.75, 0, 0] and evidence.tolist() == [4, 0, 0]
