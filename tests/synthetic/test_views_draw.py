"""Rendered views: the face of every pixel is the one hit by its ray, with matching depth, camera and colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.render.camera import CARDINAL, Sphere, camera
from afford.render.views.draw import BACKGROUND, Studio
from afford.render.views.surface import Rays
from tests.helpers.made_meshes import as_object, ball, cup, ring, slotted

SHAPES = {"ball": ball, "ring": ring, "slotted": slotted, "cup": cup}
ASIDE = np.array([0.4, -0.7, 0.5])


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_pixels_show_the_face_hit_by_their_ray(shape) -> None:  # type: ignore[no-untyped-def]
    """Rays through the pixel centres hit the rendered faces (or a neighbour at an edge) at the rendered depth."""
    thing = as_object(shape())
    shot = Studio(thing).shoot(ASIDE, 4.0, 96)
    y, x = np.mgrid[:96, :96].reshape(2, -1)
    K, T = shot.camera.K, shot.camera.T_world_cam
    sight = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], 1)
    line = sight @ T[:3, :3].T
    unit = line / np.linalg.norm(line, axis=1, keepdims=True)
    hit = Rays(thing.vertices, thing.faces).first(np.broadcast_to(T[:3, 3], line.shape), unit)
    face = shot.face.reshape(-1)
    assert (hit == face).mean() > 0.995 and ((hit < 0) == (face < 0)).mean() > 0.999
    on = face >= 0
    place = T[:3, 3] + line[on] * shot.depth_m.reshape(-1)[on, None]
    corner = thing.vertices[thing.faces[face[on]]].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.abs(((place - corner[:, 0]) * normal).sum(1)).max() < 1e-5 and on.sum() > 1000


@pytest.mark.parametrize("towards", CARDINAL.values(), ids=CARDINAL)
def test_object_fits_and_fills_the_image(towards: tuple[int, int, int]) -> None:
    """The vertices are inside the image, and one side of the image is nearly filled."""
    made = slotted()
    made.apply_scale([3, 1, 0.4])
    made.apply_translation([0.2, 1.0, -3.0])
    cam = camera(made.vertices, Sphere.of(made.vertices), np.array(towards, float), 4.0, 100)
    seen = (made.vertices - cam.T_world_cam[:3, 3]) @ cam.T_world_cam[:3, :3] @ cam.K.T
    spot = seen[:, :2] / seen[:, 2:]
    assert spot.min() >= 0 and spot.max() <= 99 and np.ptp(spot, axis=0).max() == pytest.approx(92, abs=0.5)
    assert np.linalg.det(cam.T_world_cam[:3, :3]) == pytest.approx(1)


def test_background_is_where_no_face_is() -> None:
    """The background is grey away from the outline; the object has another colour."""
    shot = Studio(as_object(ball())).shoot(ASIDE, 4.0, 64)
    assert (shot.rgb[:5, :5] == BACKGROUND).all() and shot.face[0, 0] == -1 and shot.depth_m[0, 0] == 0
    assert not (shot.rgb[shot.face >= 0] == BACKGROUND).all(1).any()


def test_texture_is_upright_and_on_its_face() -> None:
    """v points upwards: the upper half of a texture is on the faces whose corners have v above one half."""
    made = ball()
    thing = as_object(made)
    height = (thing.vertices[thing.faces][..., 2] / 0.2 + 0.5).astype(np.float32)
    texture = np.full((8, 8, 3), 20, np.uint8)
    texture[:4] = 240
    painted = replace(thing, uv=np.stack([np.full_like(height, 0.5), height.clip(0.02, 0.98)], -1), texture=texture)
    shot = Studio(painted).shoot(np.array([1.0, 0, 0]), 4.0, 96)
    z = np.append(made.triangles_center[:, 2], 0)[shot.face]
    assert shot.rgb[(z > 0.03) & (shot.face >= 0)].mean() > 2 * shot.rgb[(z < -0.03) & (shot.face >= 0)].mean()


def test_degenerate_faces_are_never_visible() -> None:
    """Degenerate faces keep their index in the numbering of the faces."""
    thing = as_object(ball())
    with_flat = replace(thing, faces=np.concatenate([[[0, 0, 1]], thing.faces]).astype(np.int32),
                        uv=np.concatenate([thing.uv[:1], thing.uv]))
    plain, flat = (Studio(one).shoot(ASIDE, 4.0, 64).face for one in (thing, with_flat))
    assert np.array_equal(np.where(plain >= 0, plain + 1, -1), flat)


def test_camera_inside_the_object_is_refused() -> None:
    """A camera in the object sees nothing of use."""
    made = ball()
    with pytest.raises(ValueError, match="outside"):
        camera(made.vertices, Sphere.of(made.vertices), ASIDE, 0.9, 64)
