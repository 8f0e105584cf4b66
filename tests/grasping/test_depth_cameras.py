"""Depth cameras: comparison with ray casting, with both engines, and depth noise."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from afford.common.files import tree
from afford.grasping.hand import read_urdf
from afford.grasping.hand.export import save_hand
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import shape_mesh
from afford.grasping.policies.depth_cameras import (
    HAND,
    NOTHING,
    OBJECT,
    RANDOM_DEPTH,
    CameraRig,
    DepthImages,
    DepthNoise,
    add_depth_noise,
    body_shape,
    hand_shape,
    random_depth_noise,
    render_depth,
    unproject,
)
from afford.render.raster import project
from afford.render.views.surface import Rays
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import worlds


@pytest.fixture(scope="module")
def scene(tmp_path_factory):  # type: ignore[no-untyped-def]
    """A moment amid a grasp by script: joints, pose, hulls, and all surfaces in the world, rounder than cameras draw."""
    core = worlds(base="script")
    for _ in range(16):
        core.step(np.zeros((2, 24)), [np.random.default_rng(0)] * 2)
    state, body = core.state(), core.tasks[0].body
    core.close()
    folder = tmp_path_factory.mktemp("hand")
    save_hand(shadow(), folder)
    read, T = read_urdf.read(tree("hand", folder)), forward_kinematics(shadow().joints, state.q[:1])[0]
    links = [shape_mesh(shape, read, 48).apply_transform(T[shadow().links.index(link.name)])
             for link in read.links for shape in link.collisions]  # fmt: skip
    turn = Rotation.from_quat(state.body[0, 3:])
    hulls = [trimesh.convex.convex_hull(turn.apply(np.array(hull)) + state.body[0, :3]) for hull in body.hulls()]
    return state.q[:1], state.body[:1], body, trimesh.util.concatenate(links), trimesh.util.concatenate(hulls)


def taken(scene, rig: CameraRig) -> DepthImages:  # type: ignore[no-untyped-def]
    q, pose, body, *_ = scene
    return render_depth(rig.cameras(), hand_shape(shadow()), [body_shape(body)], q, pose)


@pytest.mark.parametrize("rig", [CameraRig(), CameraRig(5, 64)], ids=["two of 96", "five of 64"])
def test_points_lie_on_the_surface_that_rays_hit(scene, rig: CameraRig) -> None:  # type: ignore[no-untyped-def]
    """99 % within 3 mm of the first hit of Embree through the same pixel, and of the same kind."""
    *_, hand, thing = scene
    images, cameras = taken(scene, rig), rig.cameras()
    vertices = np.concatenate([hand.vertices, thing.vertices])
    faces = np.concatenate([hand.faces, thing.faces + len(hand.vertices)])
    pixels = np.flatnonzero(images.kind[0])
    places = unproject(cameras, images.depth_m[0], pixels)
    eyes = np.array([camera.T_world_cam[:3, 3] for camera in cameras])[pixels // rig.size_px**2]
    ways = places - eyes
    hit = Rays(vertices, faces).first(eyes, ways)
    assert (hit >= 0).mean() > 0.99
    corners = vertices[faces[hit]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    share = ((corners[:, 0] - eyes) * normal).sum(1) / (ways * normal).sum(1)
    off = np.linalg.norm((share - 1)[:, None] * ways, axis=1)
    near = (hit >= 0) & (off < 0.003)
    kind = np.where(hit < len(hand.faces), HAND, OBJECT)
    assert near.mean() > 0.99
    assert (kind == images.kind[0].reshape(-1)[pixels])[near].mean() > 0.99
    assert set(np.unique(images.kind)) == {NOTHING, HAND, OBJECT}


def test_rays_through_empty_pixels_hit_nothing(scene) -> None:  # type: ignore[no-untyped-def]
    """The z-buffer has no gaps."""
    *_, hand, thing = scene
    rig = CameraRig()
    images, both = taken(scene, rig), trimesh.util.concatenate([hand, thing])
    empty = np.flatnonzero(images.kind[0] == NOTHING)
    far = unproject(rig.cameras(), np.ones_like(images.depth_m[0]), empty)
    eyes = np.array([camera.T_world_cam[:3, 3] for camera in rig.cameras()])[empty // rig.size_px**2]
    hits = (Rays(both.vertices, both.faces).first(eyes, far - eyes) >= 0).sum()
    assert hits < 0.02 * (images.kind != NOTHING).sum()


def test_unprojected_points_project_to_their_pixels(scene) -> None:  # type: ignore[no-untyped-def]
    """Unprojection and projection are inverse."""
    rig = CameraRig(3, 48)
    depth = taken(scene, rig).depth_m[0]
    pixels = np.flatnonzero(depth)
    places, cameras = unproject(rig.cameras(), depth, pixels), rig.cameras()
    for (view, y, x), place in zip(np.argwhere(depth), places, strict=True):
        u, v, z = project(place[None], cameras[view])[0]
        assert (u / z, v / z, z) == pytest.approx((x, y, depth[view, y, x]), abs=1e-4)


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_fingertips_of_engines_lie_on_the_rendered_hand(engine: str) -> None:
    """Each fingertip of the engine is in the shape of its own link, at most 1 cm from its surface."""
    core = worlds(base="script", engine=engine)
    for _ in range(5):
        core.step(np.zeros((2, 24)), [np.random.default_rng(0)] * 2)
    shape, state = hand_shape(shadow()), core.state()
    core.close()
    corners = shape.at(state.q)
    for finger, link in enumerate(shadow().fingers.tip_link):
        gap = np.linalg.norm(corners[:, shape.link == link] - state.tips[:, finger, None], axis=2).min(axis=1)
        assert (gap < 0.01).all()


def flat(depth_m: float) -> DepthImages:
    shape = (1, 1, 100, 100)
    return DepthImages(np.full(shape, depth_m, np.float32), np.full(shape, HAND, np.uint8))


def test_depth_scatter_grows_with_the_squared_distance() -> None:
    """Four times as much at twice the distance."""
    spread = [add_depth_noise(flat(z), [DepthNoise(scatter_m=0.004)], np.random.default_rng(0)).depth_m.std() for z in (0.4, 0.8)]
    assert spread == pytest.approx([0.004 * 0.16, 0.004 * 0.64], rel=0.05)


def test_depth_is_quantized_in_disparity() -> None:
    """Neighbouring depths differ by step z^2."""
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.4, 0.8, (1, 1, 200, 200)).astype(np.float32)
    found = np.unique(add_depth_noise(DepthImages(depth, np.full(depth.shape, OBJECT, np.uint8)), [DepthNoise(step_m=0.01)],
                                      rng).depth_m)  # fmt: skip
    middle = (found[1:] + found[:-1]) / 2
    assert np.diff(found) == pytest.approx(0.01 * middle**2, rel=0.02)


def test_share_of_holes_and_images_without_noise() -> None:
    """The share of holes is the requested one; without noise the images are unchanged."""
    images = add_depth_noise(flat(0.5), [DepthNoise(holes=0.2)], np.random.default_rng(0))
    assert (images.kind == NOTHING).mean() == pytest.approx(0.2, abs=0.02)
    assert np.array_equal(images.depth_m == 0, images.kind == NOTHING)
    assert images.depth_m[images.kind == HAND] == pytest.approx(0.5)
    same = flat(0.5)
    assert add_depth_noise(same, [DepthNoise()], np.random.default_rng(0)) is same


def test_random_noise_is_within_its_ranges() -> None:
    """The same seed gives the same noise; seeds differ."""
    found = [random_depth_noise(seed) for seed in range(30)]
    assert found[0] == random_depth_noise(0) != found[1]
    for name, span in RANDOM_DEPTH.items():
        assert all(span.low <= getattr(one, name) <= span.high for one in found)


@pytest.mark.parametrize("wrong", [{"views": 6}, {"views": 0}, {"size_px": 0}, {"view_deg": 180.0}])
def test_wrong_rigs_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected 1 to 5 views"):
        CameraRig(**wrong)  # type: ignore[arg-type]  # fields of Rig
