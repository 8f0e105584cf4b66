"""Surface sampling and visibility: points represent the area, and visibility agrees with rays."""

from __future__ import annotations

import numpy as np
import pytest

from afford.render.views.surface import Rays, Surface, fibonacci_sphere
from tests.helpers.made_meshes import as_object, ball, cup, ring, shell, slotted

SHAPES = {"ball": ball, "ring": ring, "slotted": slotted, "cup": cup}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_surface_points_represent_the_whole_area(shape) -> None:  # type: ignore[no-untyped-def]
    """Point areas add up to the face areas; points lie on their faces and have their normals."""
    made = shape()
    surface = Surface.of(as_object(made))
    assert np.bincount(surface.face, surface.area) == pytest.approx(made.area_faces, rel=1e-3)
    assert np.abs(((surface.points - made.triangles[surface.face, 0]) * surface.normals).sum(1)).max() < 1e-6
    assert (surface.normals * made.face_normals[surface.face]).sum(1).min() > 0.999
    assert len(np.unique(surface.face)) == len(made.faces)


def test_large_faces_have_many_points_of_equal_area() -> None:
    """A box of twelve faces is sampled at thousands of points."""
    import trimesh

    surface = Surface.of(as_object(trimesh.creation.box((0.1, 0.1, 0.1))))
    assert len(surface.points) >= 4096 and np.ptp(surface.area) < 1e-9
    assert np.abs(surface.points).max(1) == pytest.approx(0.05, abs=1e-6)


def test_inner_surfaces_are_not_visible() -> None:
    """The outer one of two nested balls is visible, the inner one is not; convex and open shapes are visible everywhere."""
    hidden = as_object(shell())
    surface = Surface.of(hidden)
    seen = surface.visible(Rays(hidden.vertices, hidden.faces), fibonacci_sphere(256))
    assert np.array_equal(seen, np.linalg.norm(surface.points, axis=1) > 0.07)
    for shape in SHAPES.values():
        thing = as_object(shape())
        surface = Surface.of(thing)
        assert surface.visible(Rays(thing.vertices, thing.faces), fibonacci_sphere(512)).mean() > 0.995


def test_directions_are_evenly_spread() -> None:
    """Directions are unit vectors, and every direction of the sphere is close to one."""
    spread = fibonacci_sphere(500)
    assert np.linalg.norm(spread, axis=1) == pytest.approx(1)
    other = np.random.default_rng(0).normal(size=(2000, 3))
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    assert np.degrees(np.arccos((other @ spread.T).max(1).clip(-1, 1))).max() < 8


def test_rays_hit_a_ball_at_the_expected_faces() -> None:
    """Rays towards the centre hit their face, others miss; outward rays from the surface escape, inward ones do not."""
    made = ball()
    rays = Rays(made.vertices, made.faces)
    middle, out = made.triangles_center, made.face_normals
    assert np.array_equal(rays.first(3 * middle, -middle), np.arange(len(made.faces)))
    aside = np.cross(middle, [0.3, 0.5, 0.7])
    assert (rays.first(3 * middle, aside / np.linalg.norm(aside, axis=1, keepdims=True)) == -1).all()
    assert rays.escape(middle, out, out).all() and not rays.escape(middle, out, -out).any()
