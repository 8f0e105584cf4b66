"""Grasp families of simple shapes at rest, by geometry and task."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from afford.grasping.env.families import FAMILIES, GraspPlace, grasp_places

NONE = np.zeros((0, 3))


def places(mesh: trimesh.Trimesh, part: trimesh.Trimesh | None = None, N_t: np.ndarray = NONE, task: str = "") -> list[GraspPlace]:
    """Places on a mesh, on all of it or on one that is joined to it, which stand on the table."""
    low = min(one.bounds[0, 2] for one in (mesh, part) if one is not None)
    found = [trimesh.sample.sample_surface(one, 2000, seed=0) for one in (mesh, part) if one is not None]
    points = np.concatenate([spots for spots, _ in found]) - (0, 0, low)
    shapes = [one for one in (mesh, part) if one is not None]
    normals = np.concatenate([one.face_normals[face] for one, (_, face) in zip(shapes, found, strict=True)])
    on = np.repeat([part is None, True], [2000, len(points) - 2000])
    return grasp_places(points, normals, on, N_t, points.mean(0), task)


def lying_bar() -> trimesh.Trimesh:
    return trimesh.creation.box((0.2, 0.025, 0.02))


def cylinder() -> trimesh.Trimesh:
    return trimesh.creation.cylinder(0.03, 0.16)


def bowl() -> trimesh.Trimesh:
    """A hemisphere shell of 3 mm, open above."""
    angle = np.linspace(0, np.pi / 2, 12)
    outer, inner = (r * np.stack([np.sin(angle), -np.cos(angle)], 1) for r in (0.07, 0.067))
    return trimesh.creation.revolve(np.concatenate([outer, inner[::-1]]))


def cup() -> trimesh.Trimesh:
    return trimesh.creation.annulus(0.037, 0.04, 0.09)


def loop() -> trimesh.Trimesh:
    """The handle of a cup: a ring in an upright plane beside it."""
    ring = trimesh.creation.torus(0.028, 0.006)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return ring.apply_translation((0.065, 0, 0))


@pytest.mark.parametrize(("mesh", "part", "family"), [
    (lying_bar(), None, "handle"), (trimesh.creation.box((0.04, 0.035, 0.03)), None, "pinch"), (cylinder(), None, "body"),
    (bowl(), None, "rim"), (cup(), loop(), "hook"),
], ids=["lying bar", "small box", "upright cylinder", "bowl", "handle of a mug"])  # fmt: skip
def test_best_family_of_a_shape(mesh: trimesh.Trimesh, part: trimesh.Trimesh | None, family: str) -> None:
    """Check the family, a fit of 0..1, unit axes, and a width that a hand spans."""
    best = places(mesh, part)[0]
    assert best.family == family in FAMILIES
    assert 0 < best.fit <= 1 and 0 <= best.width_m < 0.09
    assert np.allclose([np.linalg.norm(best.along), np.linalg.norm(best.approach)], 1)


def test_approach_of_each_family() -> None:
    """Bars, small things and walls are approached from above, bodies from the side, loops through the hole."""
    for mesh in (lying_bar(), bowl(), trimesh.creation.box((0.04, 0.035, 0.03))):
        assert places(mesh)[0].approach[2] < -0.99
    assert abs(places(cylinder())[0].approach[2]) < 0.05 and places(cylinder())[0].along[2] > 0.99
    assert abs(places(cup(), loop())[0].approach[1]) > 0.9


def test_places_keep_off_negative_points() -> None:
    """N_t on one end of a bar moves its place to the other; N_t all over leaves none."""
    bar = lying_bar()
    end = np.array([[x, 0.0, 0.01] for x in np.linspace(0, 0.1, 20)])
    assert places(bar)[0].at_m[0] == pytest.approx(0, abs=0.01)
    assert places(bar, N_t=end)[0].at_m[0] < -0.02
    assert places(bar, N_t=np.array([[x, 0.0, 0.01] for x in np.linspace(-0.1, 0.1, 40)])) == []


def test_things_that_no_hand_spans() -> None:
    """A large box and a sheet have no place; a wide bowl still has its rim."""
    assert places(trimesh.creation.box((0.3, 0.3, 0.3))) == []
    assert places(trimesh.creation.box((0.2, 0.001, 0.1))) == []
    assert places(bowl().apply_scale(2))[0].family == "rim"


def test_the_task_decides_between_families() -> None:
    """A cup of which all may be touched: around it to drink, at its rim or around it to hand it over; the order is by fit."""
    drink, give = places(cup(), task="drink tea"), places(cup(), task="hand over the cup")
    assert drink[0].family in ("body", "hook")
    rim = {name: next(one.fit for one in found if one.family == "rim") for name, found in (("drink", drink), ("give", give))}
    assert rim["give"] > rim["drink"]
    assert [one.fit for one in give] == sorted((one.fit for one in give), reverse=True)


def test_a_bar_close_above_the_body_fits_less() -> None:
    """The handle of a mug on its side, 3 cm above the rest, fits less than the same bar beside it; so does no bar high above it."""
    bar, block = trimesh.creation.box((0.12, 0.02, 0.02)), trimesh.creation.box((0.12, 0.1, 0.06))
    fits = {height: places(block, bar.copy().apply_translation((0, 0, height)))[0].fit for height in (0.07, 0.2)}
    assert 0 < fits[0.07] < 0.5 * fits[0.2]


def test_the_ends_of_a_loop_do_not_hide_the_body_under_its_bar() -> None:
    """A handle whose ends reach down to the body fits as little as a free bar."""
    block = trimesh.creation.box((0.12, 0.1, 0.2)).apply_translation((0, 0, -0.07))
    bar = trimesh.creation.box((0.11, 0.02, 0.02)).apply_translation((0, 0, 0.07))
    ends = [trimesh.creation.box((0.022, 0.02, 0.04)).apply_translation((x, 0, 0.05)) for x in (-0.034, 0.034)]
    handle = next(one for one in places(block, trimesh.boolean.union([bar, *ends])) if one.family == "handle")
    free = next(one for one in places(block, bar) if one.family == "handle")
    assert handle.fit == pytest.approx(free.fit, rel=0.2)
