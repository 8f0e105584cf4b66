"""Asset library: objects of household size that either hand can grip."""

from __future__ import annotations

import numpy as np
import pytest

from afford.render.mesh import merge
from afford.synthetic.assets import library
from afford.synthetic.assets.object_model import mirror_grip
from afford.synthetic.human_hand.skeleton import (
    distance_to,
)


@pytest.mark.parametrize("kind", sorted(library.BUILDERS))
def test_objects_rest_on_the_table_and_have_grips_for_both_hands(kind: str) -> None:
    """Each rests on z = 0, is of household size, and has a grip for the left and for the right hand."""
    model = library.build(kind, np.random.default_rng(4))
    assert -0.002 < model.points[:, 2].min() < 0.002
    assert 0.03 < model.size.max() < 0.5
    assert {grip.side for grip in model.grips} == {"left", "right"}
    for grip in model.grips:
        np.testing.assert_allclose(grip.T_obj_palm[:3, :3] @ grip.T_obj_palm[:3, :3].T, np.eye(3), atol=1e-6)
        assert np.linalg.det(grip.T_obj_palm[:3, :3]) > 0


@pytest.mark.parametrize("kind", ["mug", "kettle", "hammer", "book"])
def test_same_seed_gives_the_same_object(kind: str) -> None:
    """Shape and print depend on the generator only."""
    first, again, other = (library.build(kind, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.points.tobytes() == again.points.tobytes()
    assert all((a.material.image == b.material.image).all() for a, b in zip(first.parts, again.parts, strict=True))
    assert first.points.shape != other.points.shape or not np.allclose(first.points, other.points)


@pytest.mark.parametrize("kind", sorted(library.BUILDERS))
def test_palms_are_close_to_the_gripped_surface(kind: str) -> None:
    """The palm or the closed fingers of every grip are within reach of the surface, and the palm is not inside it."""
    model = library.build(kind, np.random.default_rng(3))
    whole = merge(*(part.mesh for part in model.parts))
    for grip in model.grips_of("right"):
        distance = distance_to(whole, np.linalg.inv(grip.T_obj_palm), grip.side, samples=3000)
        assert -0.012 < distance(np.zeros((1, 3)))[0] < 0.09, (kind, grip.name)


def test_hinge_rotates_its_part_about_its_axis() -> None:
    """Points on the axis stay; the lid's front edge rises when the joint opens."""
    box = library.build("toolbox", np.random.default_rng(0))
    assert box.joint is not None
    T = box.joint.T_obj_moving(0.5)
    np.testing.assert_allclose((T @ np.append(box.joint.origin, 1))[:3], box.joint.origin, atol=1e-9)
    front = np.array([0, -box.joint.origin[1], box.joint.origin[2], 1.0])
    assert (T @ front)[2] > front[2] + 0.02


def test_mirroring_a_grip_twice_is_the_identity() -> None:
    """Left and right grips are mirror images."""
    grip = library.build("bottle", np.random.default_rng(0)).grips[0]
    np.testing.assert_allclose(mirror_grip(mirror_grip(grip)).T_obj_palm, grip.T_obj_palm, atol=1e-12)


def test_unknown_kind_lists_the_known_kinds() -> None:
    """The error message contains the known kinds."""
    with pytest.raises(KeyError, match="mug"):
        library.build("mugg", np.random.default_rng(0))
