"""The machinery under inpainting and completion obeys its geometry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.common.masks import region_similarity
from afford.extraction.layers.align import signed_distance
from afford.extraction.layers.appearance import CONTACT_SHADE, contact_shadow, gather_colour, gather_votes, harmonic_fill, relight
from afford.extraction.layers.camera import far_homography, register
from afford.extraction.layers.parallax import Observations, reconstruct, reprojection_error, unit_matrix
from afford.extraction.layers.template import track_template
from tests.helpers.toy_clip import texture, toy

K = np.array([[300.0, 0, 160], [0, 300, 100], [0, 0, 1]])


def moving_camera(count: int) -> np.ndarray:
    """(t, 3, 4): a camera that slides sideways over a scene about one metre away."""
    slide = np.linspace(-0.12, 0.12, count)
    return np.stack([K @ np.column_stack([np.eye(3), [-x, 0.2 * x * x, 0]]) for x in slide])


def scene(depth_m: float, seed: int = 0) -> tuple[Observations, np.ndarray]:
    """Sightings, in unit coordinates, of a slanted plane with points up to `depth_m` before it; planes (t, 3, 3) that fit it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.4, 0.4, 300), rng.uniform(-0.25, 0.25, 300)
    points = np.stack([x, y, 1 + 0.3 * y - depth_m * (np.arange(300) % 3 == 0) * rng.random(300), np.ones(300)])
    cameras, unit = moving_camera(15), unit_matrix(320, 200)
    seen = unit @ cameras @ points
    xy = (seen[:, :2] / seen[:, 2:]).transpose(0, 2, 1).reshape(-1, 2)
    flat, views = np.arange(300) % 3 != 0, xy.reshape(15, 300, 2)
    planes = [cv2.findHomography(views[7][flat], view[flat])[0] for view in views]
    rows, ids = np.repeat(np.arange(15), 300), np.tile(np.arange(300), 15)
    return Observations(ids, rows, xy), np.stack(planes)


@pytest.mark.parametrize("depth_m", [0.0, 0.3])
def test_reconstruction_explains_every_sighting(depth_m: float) -> None:
    """Flat or deep, the cameras and points reproduce where the points were seen, to a quarter of a pixel."""
    seen, planes = scene(depth_m)
    unit_px = unit_matrix(320, 200)[0, 0]
    cameras, points = reconstruct(seen, planes, unit_px)
    assert np.quantile(np.linalg.norm(reprojection_error(cameras, points, seen), axis=1), 0.9) < 0.25 * unit_px


def test_a_flat_scene_gets_no_parallax() -> None:
    """A scene that planes explain has no parallax."""
    seen, planes = scene(0.0)
    assert np.abs(reconstruct(seen, planes, unit_matrix(320, 200)[0, 0])[1][:, 3]).max() < 1e-6


def test_scene_points_project_back_to_their_pixels() -> None:
    """Background.scene_points inverts the camera of the frame."""
    clip = toy(count=9)
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in clip.frames.rgb])
    background = register(grey, clip.frames.frame, ~clip.tracks.masks.any(axis=0))
    pixels = np.array([[5, 7], [120, 60], [80, 90]])
    seen = background.scene_points(4, pixels, grey.shape[1:]) @ background.cameras[4].T
    assert np.allclose(seen[:, :2] / seen[:, 2:], pixels, atol=1e-6)


def test_far_frames_are_matched() -> None:
    """A picture and its rotated, scaled copy give the homography between them."""
    picture = texture(np.random.default_rng(3), 160, 240, (120, 120, 120)).mean(axis=2).astype(np.uint8)
    turn = np.vstack([cv2.getRotationMatrix2D((120, 80), 12, 1.1), [0, 0, 1]])
    copy = cv2.warpPerspective(picture, turn, (240, 160), borderMode=cv2.BORDER_REFLECT)
    everywhere = np.ones(picture.shape, bool)
    found = far_homography(picture, copy, everywhere, everywhere)
    assert found is not None
    corners = np.array([[[60.0, 40.0], [180, 40], [180, 120], [60, 120]]])
    assert np.abs(cv2.perspectiveTransform(corners, found) - cv2.perspectiveTransform(corners, turn)).max() < 1


def test_unrelated_frames_are_not_matched() -> None:
    """Two different pictures give no homography."""
    one, other = (texture(np.random.default_rng(s), 160, 240, (120, 120, 120)).mean(axis=2).astype(np.uint8) for s in (1, 2))
    assert far_homography(one, other, np.ones(one.shape, bool), np.ones(one.shape, bool)) is None


def test_gather_colour_uses_the_quantile_of_usable_pixels() -> None:
    """The median and the 0.7 quantile of seven bright frames of ten are bright; unusable frames do not count."""
    grey = np.array([50, 50, 50, 200, 200, 200, 200, 200, 200, 200], np.uint8)
    rgb = np.broadcast_to(grey[:, None, None, None], (10, 4, 4, 3)).copy()
    usable, cameras = np.ones((10, 4, 4), bool), np.tile(np.eye(3, 4), (10, 1, 1))
    point, rows = np.array([[1.5, 1.5, 1, 0]]), np.arange(10)
    colour, found = gather_colour(point, cameras, rows, np.ones(10), rgb, usable, 0.5)
    assert (colour == 200).all()
    assert found == 10
    usable[3:] = False
    colour, found = gather_colour(point, cameras, rows, np.ones(10), rgb, usable, 0.5)
    assert (colour == 50).all()
    assert found == 3
    assert gather_colour(point, cameras, rows, np.ones(10), rgb, np.zeros_like(usable), 0.5)[1] == 0


def test_votes_count_frames_by_weight() -> None:
    """Hidden frames have no vote, inside frames vote yes."""
    inside = np.array([True, False, True])[:, None, None] & np.ones((3, 2, 2), bool)
    known = np.array([True, True, False])[:, None, None] & np.ones((3, 2, 2), bool)
    cameras, rows = np.tile(np.eye(3, 4), (3, 1, 1)), np.arange(3)
    yes, seen = gather_votes(np.array([[0.0, 1, 1, 0]]), cameras, rows, np.array([3.0, 2, 7]), inside, known)
    assert (yes[0], seen[0]) == (3, 5)


def test_distance_is_not_trusted_where_the_outline_may_be_hidden() -> None:
    """Beside an unknown region a distance counts only if it is shorter than the way to that region."""
    inside, known = np.zeros((30, 30), bool), np.ones((30, 30), bool)
    inside[10:20, 10:20] = True
    known[:, 18:] = False
    distance, trust = signed_distance(inside & known, known)
    assert distance[15, 10] == pytest.approx(0.5, abs=0.1)
    assert trust[15, 10] == 1
    assert trust[15, 17] == 0


def test_template_tracks_fast_rotation() -> None:
    """The card moves 3 px and rotates 5 degrees between frames; poses are accurate to half a pixel."""
    clip = toy(count=3)
    grey, mask = cv2.cvtColor(clip.frames.rgb[0], cv2.COLOR_RGB2GRAY), clip.amodal[0]
    turn = cv2.getRotationMatrix2D((70.0, 48.0), 5, 1)
    turn[:, 2] += [3, -1]
    moved = [cv2.warpAffine(image, turn, (grey.shape[1], grey.shape[0])) for image in (grey, mask.view(np.uint8))]
    path = track_template(np.stack([grey, moved[0]]), np.stack([mask, moved[1] > 0]), np.zeros((2, *mask.shape), bool))
    expected = np.column_stack([turn[:, :2] @ path.poses[0][:, :2], turn @ np.append(path.poses[0][:, 2], 1)])
    assert path.fit.min() > 0.95
    assert np.abs(path.poses[1] - expected).max() < 0.5


def test_following_holds_on_through_occlusion() -> None:
    """Laid over every frame, the canvas of the card covers the true card."""
    clip = toy()
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in clip.frames.rgb])
    path = track_template(grey, clip.tracks.masks[2], clip.tracks.masks[1])
    first = int(np.argmax(path.fit))
    for t in range(0, len(grey), 6):
        motion = np.vstack([path.poses[t], [0, 0, 1]]) @ np.linalg.inv(np.vstack([path.poses[first], [0, 0, 1]]))
        moved = cv2.warpAffine(clip.amodal[first].view(np.uint8), motion[:2], grey.shape[:0:-1]) > 0
        assert region_similarity(moved, clip.amodal[t]) > 0.9


def test_membrane_keeps_known_values_and_stays_between_them() -> None:
    """A surface through two values never leaves their range, and a constant stays constant."""
    values, weight = np.zeros((20, 30), np.float32), np.zeros((20, 30), np.float32)
    values[:, -1], weight[:, 0], weight[:, -1] = 1, 1, 1
    surface = harmonic_fill(values, weight)
    assert surface[:, 0].max() < 0.05
    assert surface[:, -1].min() > 0.95
    assert surface.min() >= 0
    assert surface.max() <= 1
    assert np.allclose(harmonic_fill(np.full((20, 30), 0.3, np.float32), weight), 0.3, atol=1e-5)


def test_relight_meets_the_rim() -> None:
    """A fill that is uniformly half as bright as its surroundings is brightened to match them."""
    image, fill = np.full((40, 40, 3), 120, np.uint8), np.full((40, 40, 3), 60, np.float32)
    rim = np.zeros((40, 40), bool)
    rim[8:32, 8:32] = True
    rim[12:28, 12:28] = False
    assert np.abs(relight(fill, image, rim)[12:28, 12:28] - 120).max() < 6
    assert np.array_equal(relight(fill, image, np.zeros_like(rim)), fill)


def test_contact_shadow_darkens_the_inside_only() -> None:
    """The shadow grows with depth under the hand, up to its limit."""
    hole = np.zeros((60, 60), bool)
    hole[5:55, 5:55] = True
    shade = contact_shadow(hole)
    assert (shade[~hole] == 1).all() and (np.diff(shade[30, 5:30]) < 0).all()
    assert shade.min() >= np.exp(-CONTACT_SHADE) and shade[30, 30] < 1 - CONTACT_SHADE / 2


def test_a_point_on_the_horizon_of_a_badly_linked_frame_stays_finite() -> None:
    """A homography whose horizon runs through a sighting has a large but finite miss there."""
    seen = Observations(np.array([0]), np.array([0]), np.array([[0.5, 0.0]]))
    camera = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    camera[2, 0] = -2.0
    assert np.isfinite(reprojection_error(camera[None], np.array([[0.5, 0.0, 1.0, 0.0]]), seen)).all()
