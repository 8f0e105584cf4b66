"""View planning: views are added until the visible surface is covered, and shares agree with rays."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from afford.render.camera import CARDINAL, Sphere
from afford.render.views.plan import ViewPlan, ViewSettings, plan_views, well_seen
from afford.render.views.surface import Rays, Surface, fibonacci_sphere
from tests.helpers.made_meshes import as_object, ball, cup, ring, shell, slotted

SHAPES = {"ball": ball, "ring": ring, "slotted": slotted, "cup": cup, "shell": shell}


def planned(shape: trimesh.Trimesh, wish: ViewSettings) -> tuple[ViewPlan, Surface, Rays, Sphere]:
    thing = as_object(shape)
    surface, rays, around = Surface.of(thing), Rays(thing.vertices, thing.faces), Sphere.of(thing.vertices)
    return plan_views(surface, rays, around, wish, fibonacci_sphere(256)), surface, rays, around


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_planned_views_cover_the_visible_surface(shape) -> None:  # type: ignore[no-untyped-def]
    """The views cover at least 99 % of the visible surface; the share never decreases, and the six cardinal views come first."""
    found, *_ = planned(shape(), ViewSettings(good_deg=75))
    assert found.share[-1] >= 0.99 and (np.diff(found.share) >= 0).all()
    six = found.towards[:6] / np.linalg.norm(found.towards[:6], axis=1, keepdims=True)
    assert six == pytest.approx(np.array(list(CARDINAL.values()), float))


def test_six_views_do_not_see_into_a_slot() -> None:
    """Six views cover less, and no further view is added when no share is requested."""
    six, *_ = planned(slotted(), ViewSettings(good_deg=75, share=0))
    more, *_ = planned(slotted(), ViewSettings(good_deg=75))
    assert len(six.share) == 6 and six.share[-1] < 0.85 < 0.99 <= more.share[-1]
    assert np.array_equal(six.share, more.share[:6])


def test_covered_share_agrees_with_camera_rays() -> None:
    """Rays from each camera to each surface point hit the point's own face first."""
    found, surface, rays, around = planned(cup(), ViewSettings(good_deg=75))
    seen = np.zeros(len(surface.points), bool)
    for eye in around.centre + found.towards:
        line = surface.points - eye
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        square = -(line * surface.normals).sum(1) >= np.cos(np.radians(75))
        seen |= square & (rays.first(np.broadcast_to(eye, line.shape), line) == surface.face)
    area = np.where(found.visible, surface.area, 0)
    assert area[seen].sum() / area.sum() == pytest.approx(found.share[-1], abs=0.003)


def test_viewing_angle_limit_is_respected() -> None:
    """A camera above a ball covers the analytic cap: limited by the angle and by the horizon."""
    thing = as_object(ball(0.1, 5))
    surface, rays = Surface.of(thing), Rays(thing.vertices, thing.faces)
    eye = np.array([[0, 0, 0.4]])
    for good_deg in (30.0, 60.0, 89.0):
        z = surface.points[well_seen(surface, rays, eye, good_deg)[0], 2]
        cosines = [(0.4 * h - 0.01) / (0.1 * np.sqrt(0.17 - 0.8 * h)) for h in np.linspace(0.025, 0.1, 2000)]
        lowest = np.linspace(0.025, 0.1, 2000)[np.argmax(np.array(cosines) >= np.cos(np.radians(good_deg)))]
        assert z.min() == pytest.approx(lowest, abs=0.003)


def test_number_of_views_is_limited() -> None:
    """`most` limits the number even where more views would cover more."""
    assert len(planned(cup(), ViewSettings(good_deg=60, most=8))[0].share) <= 8
