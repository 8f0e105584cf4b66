"""Laws of the asset library: objects, grips, hands, rooms and the physics that lays things down."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from afford.render import materials
from afford.render.mesh import merge
from afford.synthetic.assets import library
from afford.synthetic.assets.object_model import mirror_grip
from afford.synthetic.human_hand.appearance import random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import (
    CLOSED,
    HIGH,
    LOW,
    POSTURES,
    SINK_M,
    close_on,
    distance_to,
    link_depths,
    opening_posture,
    posture,
)
from afford.synthetic.human_hand.skin import hand_shape
from afford.synthetic.kitchens import rooms
from afford.synthetic.kitchens.settle_env import Settle, rest_poses

ELBOW = np.array([0.3, -0.4, 0.1])


@pytest.mark.parametrize("kind", sorted(library.BUILDERS))
def test_objects_stand_on_the_table_and_can_be_held_by_either_hand(kind: str) -> None:
    """Each rests on z = 0, is of household size, and has a grip for the left and for the right hand."""
    model = library.build(kind, np.random.default_rng(4))
    assert -0.002 < model.points[:, 2].min() < 0.002
    assert 0.03 < model.size.max() < 0.5
    assert {grip.side for grip in model.grips} == {"left", "right"}
    for grip in model.grips:
        np.testing.assert_allclose(grip.T_obj_palm[:3, :3] @ grip.T_obj_palm[:3, :3].T, np.eye(3), atol=1e-6)
        assert np.linalg.det(grip.T_obj_palm[:3, :3]) > 0


@pytest.mark.parametrize("kind", ["mug", "kettle", "hammer", "book"])
def test_the_same_seed_gives_the_same_object_and_another_seed_another(kind: str) -> None:
    """Shape and print come out of the generator alone."""
    first, again, other = (library.build(kind, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.points.tobytes() == again.points.tobytes()
    assert all((a.material.image == b.material.image).all() for a, b in zip(first.parts, again.parts, strict=True))
    assert first.points.shape != other.points.shape or not np.allclose(first.points, other.points)


@pytest.mark.parametrize("kind", sorted(library.BUILDERS))
def test_palms_touch_what_they_hold(kind: str) -> None:
    """The palm or the closed fingers of every grip are within reach of the surface, and the palm is not inside it."""
    model = library.build(kind, np.random.default_rng(3))
    whole = merge(*(part.mesh for part in model.parts))
    for grip in model.grips_of("right"):
        distance = distance_to(whole, np.linalg.inv(grip.T_obj_palm), grip.side, samples=3000)
        assert -0.012 < distance(np.zeros((1, 3)))[0] < 0.09, (kind, grip.name)


def test_a_hinge_moves_its_part_about_its_axis() -> None:
    """Points on the axis stay; the lid's front edge rises when the joint opens."""
    box = library.build("toolbox", np.random.default_rng(0))
    assert box.joint is not None
    T = box.joint.T_obj_moving(0.5)
    np.testing.assert_allclose((T @ np.append(box.joint.origin, 1))[:3], box.joint.origin, atol=1e-9)
    front = np.array([0, -box.joint.origin[1], box.joint.origin[2], 1.0])
    assert (T @ front)[2] > front[2] + 0.02


def test_mirroring_a_grip_twice_gives_it_back() -> None:
    """Left and right grips are mirror images."""
    grip = library.build("bottle", np.random.default_rng(0)).grips[0]
    np.testing.assert_allclose(mirror_grip(mirror_grip(grip)).T_obj_palm, grip.T_obj_palm, atol=1e-12)


def test_hands_are_mirror_images() -> None:
    """The left hand is the right one mirrored in its palm frame."""
    look = random_person(np.random.default_rng(0))
    left, right = HandModel.build("left", look), HandModel.build("right", look)
    angles = posture("relaxed")
    a = left.posed(np.eye(4), angles, ELBOW * [1, -1, 1])
    b = right.posed(np.eye(4), angles, ELBOW)
    np.testing.assert_allclose(a * [1, -1, 1], b, atol=1e-5)


def test_a_hand_at_rest_is_its_rest_shape_and_moves_rigidly() -> None:
    """Zero angles give the rest skin; moving the palm and the elbow together moves every vertex alike."""
    hand = HandModel.build("right", random_person(np.random.default_rng(0)))
    straight = np.array([-0.5, 0.0, -0.016])
    np.testing.assert_allclose(hand.posed(np.eye(4), np.zeros(20), straight), hand_shape().vertices, atol=1e-4)
    T = np.eye(4)
    T[:3, 3] = (0.1, 0.2, 0.3)
    np.testing.assert_allclose(hand.posed(T, np.zeros(20), straight + T[:3, 3]), hand_shape().vertices + T[:3, 3], atol=1e-4)


def test_skin_weights_are_shares() -> None:
    """Every vertex follows its bones with weights that add up to one."""
    weights = hand_shape().weights
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("kind", sorted(CLOSED))
@pytest.mark.parametrize("radius", [0.012, 0.03, 0.045])
def test_fingers_close_until_they_touch_and_no_deeper(kind: str, radius: float) -> None:
    """After closing on a rod at least one finger touches it, none is pressed in deeper than the flesh gives way."""

    def rod(p: np.ndarray) -> np.ndarray:
        return np.hypot(p[:, 0] - 0.03, p[:, 2] - radius - 0.02) - radius

    angles = close_on(kind, rod)
    depth, start = link_depths(angles, rod), link_depths(opening_posture(kind), rod)
    assert (depth <= np.maximum(start, SINK_M) + 1e-9).all()
    assert depth.max() > -0.004


@pytest.mark.parametrize("kind", sorted(POSTURES))
def test_postures_stay_within_the_joints(kind: str) -> None:
    """No preset bends a joint further than it goes."""
    angles = posture(kind)
    assert (angles >= LOW - 1e-9).all() and (angles <= HIGH + 1e-9).all()


def test_materials_differ_by_seed_and_have_detail() -> None:
    """Surfaces that optical flow shall follow have texture."""
    for make in (materials.wood, materials.granite, materials.laminate, materials.marble):
        first, other = make(np.random.default_rng(1)), make(np.random.default_rng(2))
        assert first.image.std() > 4
        assert (first.image != other.image).any()


@pytest.mark.parametrize("setting", sorted(rooms.SETTINGS))
def test_rooms_keep_the_middle_free_and_repeat_by_seed(setting: str) -> None:
    """Nothing taller than a mat stands where the hands work; the same seed builds the same room."""
    first, again = (rooms.build_room(setting, np.random.default_rng(5)) for _ in range(2))
    assert first.light == again.light
    for one, two in zip(first.instances, again.instances, strict=True):
        assert one.T_world_mesh.tobytes() == two.T_world_mesh.tobytes()
        assert one.mesh.vertices.tobytes() == two.mesh.vertices.tobytes()
        world = one.mesh.vertices @ one.T_world_mesh[:3, :3].T + one.T_world_mesh[:3, 3]
        middle = (np.abs(world[:, 0]) < 0.25) & (world[:, 1] > 0.0) & (world[:, 1] < 0.45)
        assert not middle.any() or world[middle, 2].max() < 0.01


def test_an_unknown_kind_lists_the_known_ones() -> None:
    """Mistakes are answered with the choice."""
    with pytest.raises(KeyError, match="mug"):
        library.build("mugg", np.random.default_rng(0))


def test_the_settling_world_is_a_sound_environment() -> None:
    """Gymnasium's checker has nothing to say."""
    env = gymnasium.make("afford/Settle-v0").unwrapped
    check_env(env, skip_render_check=True)
    env.close()
    env.close()


def test_things_come_to_rest_on_the_table_the_same_way_twice() -> None:
    """After settling everything lies on the table, and the same seed gives the same poses."""
    shapes = [library.build(kind, np.random.default_rng(1)).points for kind in ("can", "spoon")]
    first, again = rest_poses(shapes, 7), rest_poses(shapes, 7)
    for points, T, same in zip(shapes, first, again, strict=True):
        assert T.tobytes() == same.tobytes()
        assert -0.004 < (points @ T[:3, :3].T + T[:3, 3])[:, 2].min() < 0.02


def test_a_step_before_reset_is_refused() -> None:
    """The environment says what to do."""
    with pytest.raises(RuntimeError, match="reset"):
        Settle().poses()


def test_the_skin_is_closed_but_for_the_elbow() -> None:
    """Every edge has two faces, save where the arm ends behind the elbow."""
    shape = hand_shape()
    edges = np.sort(np.concatenate([shape.faces[:, [0, 1]], shape.faces[:, [1, 2]], shape.faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    open_end = shape.vertices[unique[count == 1]][:, :, 0]
    assert open_end.size == 0 or open_end.max() < -0.4
