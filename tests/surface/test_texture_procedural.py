"""Procedural texture: regions by thickness, invisible seams, determinism."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from afford.surface.meshes.texture import sample_texture
from afford.surface.texture.procedural import paint_regions, wave_noise
from afford.surface.texture.shape_regions import main_axis, shape_regions, thickness
from tests.helpers.mesh_files import box, places


def spoon() -> trimesh.Trimesh:
    """Build a thick handle (y < 0) and a thin blade in one body."""
    handle, blade = trimesh.creation.box((0.025, 0.12, 0.02)), trimesh.creation.box((0.03, 0.12, 0.002))
    handle.apply_translation([0, -0.06, 0])
    blade.apply_translation([0, 0.059, 0])
    out = trimesh.boolean.union([handle, blade], engine="manifold")
    return out.subdivide_to_size(0.004)


def test_thickness_is_that_of_the_body() -> None:
    """Check the faces of a slab; the cone makes them slightly thicker."""
    slab = trimesh.creation.box((0.1, 0.1, 0.01)).subdivide_to_size(0.01)
    thick = thickness(np.asarray(slab.vertices), np.asarray(slab.faces))
    top = (np.abs(slab.face_normals[:, 2]) > 0.9) & (np.abs(slab.triangles_center[:, :2]).max(axis=1) < 0.03)
    assert thick[top] == pytest.approx(0.01 / np.cos(np.radians(25)), rel=0.02)


def test_thin_and_thick_parts_are_separate_regions() -> None:
    """Check that most of the blade and none of the handle is the thinnest region."""
    solid = spoon()
    region, thick = shape_regions(np.asarray(solid.vertices), np.asarray(solid.faces), 3)
    place, area = solid.triangles_center[:, 1], solid.area_faces
    blade, handle = place > 0.01, place < -0.01
    assert 2 <= len(thick) <= 3 and (np.diff(thick) > 0).all()
    assert area[blade & (region == 0)].sum() > 0.9 * area[blade].sum()
    assert area[handle & (region == 0)].sum() < 0.1 * area[handle].sum()


def test_ball_is_one_region() -> None:
    """Check a shape without parts."""
    ball = trimesh.creation.icosphere(4, 0.05)
    assert len(shape_regions(np.asarray(ball.vertices), np.asarray(ball.faces), 3)[1]) == 1


def test_regions_rotate_with_the_object() -> None:
    """Check another pose."""
    solid = spoon()
    T = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3], [0.1, 0, 0])
    turned = trimesh.transform_points(solid.vertices, T)
    a, b = (shape_regions(np.asarray(v), np.asarray(solid.faces), 2)[0] for v in (solid.vertices, turned))
    assert (a == b).mean() > 0.97


def test_first_axis_is_the_longest() -> None:
    """Check a box along y."""
    solid = box()
    middle, axes = main_axis(np.asarray(solid.vertices), np.asarray(solid.faces))
    assert np.allclose(middle, 0, atol=1e-9) and np.allclose(np.abs(axes[0]), [0, 1, 0], atol=1e-6)


def test_texture_depends_on_the_seed() -> None:
    """Check that the texture is a function of mesh and seed."""
    solid = spoon()
    v, f = np.asarray(solid.vertices, np.float32), np.asarray(solid.faces, np.int32)
    a, b, c = (paint_regions(v, f, 3, 128, seed) for seed in (0, 0, 1))
    assert a[0].tobytes() == b[0].tobytes() and a[1].tobytes() == b[1].tobytes() and a[1].tobytes() != c[1].tobytes()


def test_faces_have_the_material_of_their_region() -> None:
    """Check that blade and handle differ in colour everywhere."""
    solid = spoon()
    v, f = np.asarray(solid.vertices, np.float32), np.asarray(solid.faces, np.int32)
    uv, image = paint_regions(v, f, 2, 256, 0)
    face, bary, points = places(solid.vertices, f, 2000)
    seen = sample_texture(image, np.einsum("nk,nkc->nc", bary, uv[face])).astype(int).sum(axis=1)
    assert seen[points[:, 1] > 0.02].mean() > 500 and (seen[points[:, 1] > 0.02] > 450).mean() > 0.97
    assert (seen[points[:, 1] < -0.02] < 450).mean() > 0.97


def test_noise_mean_and_scale() -> None:
    """Check the range, and the correlation at two distances."""
    rng = np.random.default_rng(0)
    points = rng.random((20_000, 3))
    value, near = wave_noise(points, np.random.default_rng(1), 0.1), wave_noise(points + 0.001, np.random.default_rng(1), 0.1)
    assert abs(value.mean()) < 0.1 and 0.3 < value.std() < 1.0 and np.abs(value - near).mean() < 0.1
