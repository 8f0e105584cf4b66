"""Software rasterizer: analytic geometry, exact ids, and shared shading without differences."""

from __future__ import annotations

import numpy as np
import pytest

from afford.render.draw import draw_ids, render, render_bundle
from afford.render.mesh import merge, translate
from afford.render.scene import BACKGROUND, Camera, Instance, Light, Material, Textures
from afford.render.solids import box, lathe, patch, tube

GREY = Material(np.full((8, 8, 3), 128, np.uint8))
NOISE = Material(np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8))


def camera(width: int = 96, height: int = 64, eye: tuple[float, float, float] = (0.0, 0.0, 0.6)) -> Camera:
    """Camera that looks straight down: world x is right and world y is up in the image."""
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]])
    T[:3, 3] = eye
    return Camera(np.array([[80.0, 0, width / 2], [0, 80.0, height / 2], [0, 0, 1]]), T, width, height)


def table(material: Material = NOISE) -> Instance:
    return Instance(patch(np.array([-1.0, -1, 0]), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]), (6, 6)), material, casts=False)


def scene() -> list[Instance]:
    """A table, a box (0) and a tube over it (1)."""
    stick = translate(tube(np.array([(-0.2, 0, 0), (0.0, 0.0, 0), (0.2, 0.02, 0)]), 0.02), 0, 0, 0.15)
    return [table(), Instance(box((0.1, 0.1, 0.06), 0.004), GREY, entity=0), Instance(stick, GREY, entity=1)]


def textures(instances: list[Instance]) -> Textures:
    return Textures.of(i.material for i in instances)


def test_depth_of_a_plane_is_constant() -> None:
    """Depth is distance along the optical axis, not along the ray."""
    ids, depth = draw_ids([table()], camera(), textures([table()]))
    assert (ids == BACKGROUND).all()
    np.testing.assert_allclose(depth, 0.6, atol=1e-5)


def test_square_covers_the_pixels_with_covered_centres() -> None:
    """An id is what the ray through the pixel centre (integer coordinates) hits."""
    square = Instance(patch(np.array([-0.061, -0.031, 0.2]), np.array([0.122, 0, 0]), np.array([0, 0.062, 0])), GREY, entity=3)
    ids, _ = draw_ids([table(), square], camera(), textures([table(), square]))
    y, x = np.nonzero(ids == 3)
    assert (x.min(), x.max(), y.min(), y.max()) == (36, 60, 26, 38)


def test_triangles_that_cross_the_camera_plane_are_drawn() -> None:
    """An arm that comes from behind the camera needs no clipping."""
    road = Instance(patch(np.array([-0.1, -2.0, -0.1]), np.array([0.2, 0, 0]), np.array([0, 4.0, 0])), GREY, entity=0)
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    ahead = Camera(camera().K, T, 96, 64)
    ids, depth = draw_ids([road], ahead, textures([road]))
    assert (ids[-1, 40:56] == 0).all()
    np.testing.assert_allclose(depth[63, 48], 0.1 * 80 / 31, rtol=1e-4)


def test_bundle_equals_separate_renderings() -> None:
    """Shading only the pixels that hands or their shadows reach gives the bytes of a separate rendering without hands."""
    parts, light = scene(), Light(centre=(0, 0, 0.1), radius_m=0.5)
    pool = textures(parts)
    bundle = render_bundle(parts, [1], 2, camera(), light, pool)
    bare = [i for i in parts if i.entity != 1]
    assert (bundle.rgb == render(parts, camera(), light, pool).rgb).all()
    assert (bundle.rgb_no_hands == render(bare, camera(), light, pool).rgb).all()
    assert (bundle.rgb_no_hands_shadow == render(bare, camera(), light, pool, shadow_casters=parts).rgb).all()
    assert (bundle.rgb_no_hands != bundle.rgb_no_hands_shadow).any()


def test_amodal_masks_contain_visible_ones() -> None:
    """Visible pixels of an entity are amodal ones, and a hidden part is not visible."""
    parts = scene()
    bundle = render_bundle(parts, [1], 2, camera(), Light(), textures(parts))
    for entity in range(2):
        assert not ((bundle.ids == entity) & ~bundle.amodal[entity]).any()
    assert (bundle.amodal[0] & (bundle.ids == 1)).any()


def test_shadows_darken_only() -> None:
    """An object above the table removes light and adds none."""
    parts = scene()
    bundle = render_bundle(parts, [1], 2, camera(), Light(), textures(parts))
    open_table = bundle.ids == BACKGROUND
    less = bundle.rgb_no_hands_shadow.astype(int) - bundle.rgb_no_hands
    assert less[open_table].max() <= 2
    assert less[open_table].min() < -20


def test_same_scene_gives_the_same_bytes() -> None:
    """The renderer is deterministic."""
    parts = scene()
    first, second = (render(parts, camera(), Light(), textures(parts)) for _ in range(2))
    assert first.rgb.tobytes() == second.rgb.tobytes()


def test_distant_fine_texture_is_filtered_to_its_mean() -> None:
    """Texture filtering averages distant noise, so textures do not shimmer."""
    far = render([table()], camera(eye=(0.0, 0.0, 20.0)), Light(vignette=0.0), textures([table()]))
    inside = far.rgb[30:34, 46:50].astype(float)
    assert inside.std(axis=(0, 1)).max() < 8


def test_texture_sides_must_be_powers_of_two() -> None:
    """The texture pool refuses sizes that its filter cannot wrap."""
    with pytest.raises(ValueError, match="powers of two"):
        Textures.of([Material(np.zeros((30, 32, 3), np.uint8))])


@pytest.mark.parametrize(
    "shape",
    [
        box((0.1, 0.2, 0.3), 0.01),
        lathe(np.array([(0, 0), (0.1, 0), (0.1, 0.2), (0, 0.2)])),
        tube(np.array([(0, 0, 0), (0.1, 0, 0), (0.2, 0.1, 0)]), 0.02),
    ],
)
def test_solids_are_closed_and_face_outwards(shape) -> None:  # type: ignore[no-untyped-def]
    """The volume under the faces is positive and near that of the solid."""
    tri = shape.vertices[shape.faces].astype(float)
    volume = np.einsum("fi,fi->f", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])).sum() / 6
    extent = np.ptp(shape.vertices, axis=0).prod()
    assert 0.05 * extent < volume <= 1.001 * extent
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1, atol=1e-4)


def test_merging_keeps_every_face() -> None:
    """Faces of later shapes refer to their own vertices."""
    both = merge(box((0.1, 0.1, 0.1)), translate(box((0.1, 0.1, 0.1)), 1.0))
    assert both.faces.max() == len(both.vertices) - 1
    np.testing.assert_allclose(both.bounds[1, 0] - both.bounds[0, 0], 1.1, atol=1e-5)
