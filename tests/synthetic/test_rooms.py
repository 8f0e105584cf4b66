"""Rooms, materials and the settling environment."""

from __future__ import annotations

import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from afford.render import materials
from afford.synthetic.assets import library
from afford.synthetic.kitchens import rooms
from afford.synthetic.kitchens.settle_env import Settle, rest_poses


def test_materials_differ_by_seed_and_have_texture() -> None:
    """Surfaces for optical flow need texture."""
    for make in (materials.wood, materials.granite, materials.laminate, materials.marble):
        first, other = make(np.random.default_rng(1)), make(np.random.default_rng(2))
        assert first.image.std() > 4
        assert (first.image != other.image).any()


@functools.cache
def room(setting: str) -> rooms.Room:
    """Build the room of a setting once."""
    return rooms.build_room(setting, np.random.default_rng(5))


@pytest.mark.parametrize("setting", ["desk", *(pytest.param(name, marks=pytest.mark.slow) for name in ("kitchen", "workshop"))])
def test_same_seed_builds_the_same_room(setting: str) -> None:
    """Light, poses and vertices are equal to the byte."""
    first, again = room(setting), rooms.build_room(setting, np.random.default_rng(5))
    assert first.light == again.light
    for one, two in zip(first.instances, again.instances, strict=True):
        assert one.T_world_mesh.tobytes() == two.T_world_mesh.tobytes()
        assert one.mesh.vertices.tobytes() == two.mesh.vertices.tobytes()


@pytest.mark.parametrize("setting", sorted(rooms.SETTINGS))
def test_rooms_keep_the_work_area_free(setting: str) -> None:
    """The work area of the hands contains no instance taller than a mat."""
    for one in room(setting).instances:
        world = one.mesh.vertices @ one.T_world_mesh[:3, :3].T + one.T_world_mesh[:3, 3]
        middle = (np.abs(world[:, 0]) < 0.25) & (world[:, 1] > 0.0) & (world[:, 1] < 0.45)
        assert not middle.any() or world[middle, 2].max() < 0.01


def test_settle_environment_passes_the_gymnasium_checker() -> None:
    """`check_env` reports no fault."""
    env = gymnasium.make("afford/Settle-v0").unwrapped
    check_env(env, skip_render_check=True)
    env.close()
    env.close()


def test_dropped_objects_settle_reproducibly() -> None:
    """Objects end on the table, and the same seed gives the same poses."""
    shapes = [library.build(kind, np.random.default_rng(1)).points for kind in ("can", "spoon")]
    first, again = rest_poses(shapes, 7), rest_poses(shapes, 7)
    for points, T, same in zip(shapes, first, again, strict=True):
        assert T.tobytes() == same.tobytes()
        assert -0.004 < (points @ T[:3, :3].T + T[:3, 3])[:, 2].min() < 0.02


def test_poses_before_reset_are_refused() -> None:
    """The error recommends `reset`."""
    with pytest.raises(RuntimeError, match="reset"):
        Settle().poses()
