"""Projection of negative affordance: votes, part posterior, harmonic fill and distances against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from afford.surface.negative.project import (
    cos_incidence,
    distance_field,
    distance_to_points,
    face_adjacency,
    harmonic_fill,
    part_posterior,
    pixel_probability,
    vote_on_faces,
)
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescription, PartNote, PartScores
from stages.surface import view_render
from tests.helpers.made_meshes import as_object, ball, ring, slotted
from tests.helpers.made_objects import between_nodes

SHAPES = {"ball": ball, "ring": ring, "slotted": slotted}
SMALL = view_render.Params(size_px=192, directions=128)


def truth_of(middle: np.ndarray) -> np.ndarray:
    """Half-space beyond a slanted plane."""
    return np.asarray(middle @ [0.6, 0.3, 0.74] > 0.01)


@pytest.fixture(scope="module", params=SHAPES.values(), ids=SHAPES)
def seen(request: pytest.FixtureRequest) -> tuple[ObjectMesh, ObjectViews]:
    thing = as_object(request.param())
    return thing, view_render.run(thing, SMALL)


def test_painted_part_is_recovered_on_the_surface(seen: tuple[ObjectMesh, ObjectViews]) -> None:
    """Check that every visible face has exactly its own value, without bleeding at outlines."""
    thing, views = seen
    truth = truth_of(thing.vertices[thing.faces].mean(1))
    painted = np.append(truth, False)[views.face].astype(np.float32)
    probability, evidence = vote_on_faces(views.face, painted, cos_incidence(thing, views), len(thing.faces))
    known = evidence > 0
    assert np.array_equal(probability[known], truth[known].astype(np.float32)) and 0 < truth[known].mean() < 1
    assert views.visible_area[known].sum() / views.visible_area.sum() > 0.97


def test_cosine_of_incidence(seen: tuple[ObjectMesh, ObjectViews]) -> None:
    """Check the range, 0 for background, and equality with the angle from depth."""
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
    """Check values by hand, weight 0, and an unseen face."""
    face = np.array([[[0, 0, 1, -1]]], np.int32)
    value = np.array([[[1.0, 0.0, 1.0, 1.0]]], np.float32)
    probability, evidence = vote_on_faces(face, value, np.array([[[3.0, 1.0, 0.0, 5.0]]], np.float32), 3)
    assert probability.tolist() == [0.75, 0, 0] and evidence.tolist() == [4, 0, 0]


def description(*roles: str) -> PartDescription:
    notes = tuple(PartNote(f"p{n}", f"the p{n}", role, "", 1.0, False) for n, role in enumerate(roles))  # type: ignore[arg-type]
    return PartDescription("x", "thing", "use", notes, "rules")


def scores(*rows: tuple[float, ...]) -> PartScores:
    """Scores in which every candidate is the whole visible part."""
    share = np.array(rows, np.float32)
    return PartScores("x", share, np.ones_like(share))


def test_better_fit_wins_at_low_fits() -> None:
    """Check that only the ratio counts, and that neutral parts compete."""
    value, sure = part_posterior(scores((0.2, 0.1), (0.8, 0.4), (0.1, 0.8)), description("negative", "positive"))
    assert value[:2] == pytest.approx([0.8, 0.8], abs=0.02) and sure[0] == pytest.approx(sure[1])
    value, _ = part_posterior(scores((0.5, 0.5, 0.5)), description("negative", "positive", "neutral"))
    assert value == pytest.approx([1 / 3])


def test_weight_grows_with_certainty() -> None:
    """Check equal fits, fits below the threshold, and certain fits."""
    given = scores((0.5, 0.5), (0.05, 0.0), (0.9, 0.01), (0.6, 0.3), (0.01, 0.9))
    _, sure = part_posterior(given, description("negative", "positive"))
    assert sure[1] == 0 and sure[0] < 0.05 < sure[3] < sure[2]


def test_pixels_average_their_candidates() -> None:
    """Check that the certain mask prevails, and weight 0 without a mask."""
    masks = np.zeros((2, 1, 4), bool)
    masks[0, 0, :2], masks[1, 0, 1:3] = True, True
    candidates = PartCandidates("x", np.zeros(2, np.int16), masks, np.ones(2, np.float32))
    face = np.zeros((1, 1, 4), np.int32)
    value, weight = pixel_probability(candidates, scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"), face)
    said, sure = part_posterior(scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"))
    assert value[0, 0, [0, 2]] == pytest.approx(said) and weight[0, 0, 3] == value[0, 0, 3] == 0
    assert value[0, 0, 1] == pytest.approx((said * sure).sum() / sure.sum()) and value[0, 0, 1] > said.mean()


def test_poorly_fitting_parts_are_normalised_by_their_best_fit() -> None:
    """Check a trigger at 0.3 with a body at 0.5, with and without a better candidate for the trigger."""
    roles = description("negative", "positive")
    alone, beside = (part_posterior(scores((0.3, 0.5), other), roles)[0] for other in ((0.0, 0.9), (0.9, 0.0)))
    assert alone[0] > beside[0]
    both = PartScores("x", np.array([[0.5, 0.5]], np.float32), np.array([[0.9, 0.2]], np.float32))
    assert part_posterior(both, roles)[0][0] > 0.6


def test_small_masks_outvote_large_ones() -> None:
    """Check the ratio of sizes, independent of the size of the view."""
    masks = np.zeros((2, 1, 8), bool)
    masks[0, 0, :1], masks[1, 0, :4] = True, True
    candidates = PartCandidates("x", np.zeros(2, np.int16), masks, np.ones(2, np.float32))
    told, roles = scores((0.9, 0.0), (0.0, 0.9)), description("negative", "positive")
    for beyond in (0, 30):
        face = np.full((1, 1, 8 + beyond), -1, np.int32)
        face[..., :8] = 0
        wide = PartCandidates("x", candidates.view, np.pad(masks, ((0, 0), (0, 0), (0, beyond))), candidates.quality)
        value, weight = pixel_probability(wide, told, roles, face)
        assert value[0, 0, 0] == pytest.approx(0.8, abs=0.01) and weight[0, 0, 0] == pytest.approx(5 * weight[0, 0, 1], rel=0.01)


def test_description_without_notes_has_no_weight() -> None:
    """Check no note, and one note."""
    value, sure = part_posterior(PartScores("x", np.zeros((3, 0), np.float32), np.zeros((3, 0), np.float32)), description())
    assert not value.any() and not sure.any()
    value, sure = part_posterior(scores((0.7,), (0.01,)), description("negative"))
    assert value[0] == pytest.approx(1) and sure[0] > 1 and sure[1] == 0


def strip(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Build a straight ribbon of `count` equal triangles."""
    x = np.arange(count + 2)
    vertices = np.stack([x / 2, (x % 2).astype(float), 0 * x], -1).astype(np.float32)
    return vertices, np.stack([x[:-2], x[1:-1], x[2:]], -1).astype(np.int32)


def test_fill_between_two_ends_is_linear() -> None:
    """Check heat conduction in a rod."""
    vertices, faces = strip(11)
    known = np.isin(np.arange(11), [0, 10])
    found = harmonic_fill(vertices, faces, known * np.linspace(0, 1, 11), known)
    assert found == pytest.approx(np.linspace(0, 1, 11), abs=1e-5)


def test_fill_obeys_the_maximum_principle(seed: int = 0) -> None:
    """Check a ball with a third of the faces known."""
    made, rng = ball(0.1, 3), np.random.default_rng(seed)
    known, value = rng.random(len(made.faces)) < 0.3, rng.uniform(0.2, 0.7, len(made.faces)).astype(np.float32)
    found = harmonic_fill(made.vertices, made.faces, value, known)
    assert np.array_equal(found[known], value[known]) and found.min() >= 0.2 - 1e-6 and found.max() <= 0.7 + 1e-6
    rows = face_adjacency(made.vertices, made.faces)[~known]
    assert found[~known] == pytest.approx((rows @ found) / rows.sum(1), abs=1e-4)


def test_fill_crosses_seams_but_not_gaps() -> None:
    """Check triangles without common vertices, and a second body."""
    vertices, faces = strip(5)
    apart = vertices[faces].reshape(-1, 3), np.arange(15, dtype=np.int32).reshape(-1, 3)
    known = np.isin(np.arange(5), [0])
    assert harmonic_fill(*apart, np.full(5, 0.9, np.float32), known) == pytest.approx([0.9] * 5)
    far = np.concatenate([vertices, vertices[:3] + np.float32([0, 9, 0])]), np.concatenate([faces, [[7, 8, 9]]]).astype(np.int32)
    ends = np.isin(np.arange(6), [0, 4])
    found = harmonic_fill(*far, np.float32([0.1, 0, 0, 0, 0.8, 0]), ends)
    assert found[5] == pytest.approx(found[:5][np.linalg.norm(vertices[faces].mean(1) - far[0][7:].mean(0), axis=1).argmin()])


def test_fill_without_known_faces_is_zero() -> None:
    """Check no known face, and all faces known."""
    made = ball(0.1, 1)
    value = np.linspace(0, 1, len(made.faces)).astype(np.float32)
    assert not harmonic_fill(made.vertices, made.faces, value, np.zeros(len(value), bool)).any()
    assert np.array_equal(harmonic_fill(made.vertices, made.faces, value, np.ones(len(value), bool)), value)


def test_adjacency_of_a_closed_surface() -> None:
    """Check three mutual neighbours of each face."""
    made = trimesh.creation.box()
    graph = face_adjacency(made.vertices, made.faces)
    assert ((graph > 0).sum(1) == 3).all() and abs(graph - graph.T).max() < 1e-12


def test_distance_to_a_point_is_the_norm() -> None:
    """Check an empty N_t: infinite."""
    spots = np.random.default_rng(0).normal(size=(50, 3))
    assert distance_to_points(np.array([[1.0, 2, 3]]), spots) == pytest.approx(np.linalg.norm(spots - [1, 2, 3], axis=1))
    assert np.isinf(distance_to_points(np.zeros((0, 3)), spots)).all()


def test_distance_grid_error_is_bounded() -> None:
    """Check sqrt(3) spacings between nodes, and exact nodes, after trilinear interpolation."""
    made = ball(0.05, 2)
    negative = made.vertices[made.vertices[:, 2] > 0.02]
    grid = distance_field("ball", negative, made.vertices, 0.005, 0.03)
    spots = np.random.default_rng(1).uniform(-0.08, 0.08, (400, 3))
    assert np.abs(between_nodes(grid)(spots) - distance_to_points(negative, spots)).max() < 3**0.5 * 0.005
    nodes = grid.origin + grid.spacing_m * np.array([[0, 0, 0], [3, 5, 7], [10, 2, 9]])
    assert between_nodes(grid)(nodes) == pytest.approx(distance_to_points(negative, nodes), abs=1e-6)


def test_distance_grid_without_n_t_is_infinite() -> None:
    """Check the whole grid."""
    made = ball(0.05, 1)
    grid = distance_field("ball", np.zeros((0, 3), np.float32), made.vertices, 0.02, 0.02)
    assert np.isinf(grid.distance_m).all()
