"""Observation of the student: nothing of the object's state passes through except what cameras show."""

from __future__ import annotations

import ast
import inspect
from typing import Any

import numpy as np
import pytest

from afford.grasping.env import actions
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import LAYOUTS
from afford.grasping.policies import depth_cameras, proprioception
from afford.grasping.policies import student_obs as student_obs_module
from afford.grasping.policies.depth_cameras import DepthNoise
from afford.grasping.policies.student import StudentObserver, StudentSensors
from afford.grasping.policies.student_obs import SAMPLINGS, CloudSampling, StudentObs, student_obs
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import crumb, put, rngs, worlds


def same(one: StudentObs, other: StudentObs) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


def in_the_palm(core: GraspWorlds, seed: int) -> np.ndarray:
    """(n, 7) a pose at which a crumb is inside the palm's box, turned at random."""
    shape = StudentObserver(core, StudentSensors()).hand
    corners = shape.at(core.state().q)[:, shape.link == shadow().palm][:, :8]
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(len(corners), 4))
    places = corners.mean(axis=1) + rng.uniform(-0.001, 0.001, (len(corners), 3))
    return np.concatenate([places, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)], axis=1)


def test_inputs_are_images_proprioception_and_negative_points() -> None:
    """Check the arguments of `student_obs`, the imports of its module, and the fields of its inputs."""
    assert list(inspect.signature(student_obs).parameters) == ["images", "own", "N_t", "any_N", "cameras", "body", "start", "eyes"]
    found = {name.name for node in ast.walk(ast.parse(inspect.getsource(student_obs_module))) if isinstance(node, ast.ImportFrom)
             for name in node.names}  # fmt: skip
    assert not found & {"State", "Snapshot", "EpisodeFrame", "Scenery", "Measures", "GraspWorlds", "Task", "GraspObject"}
    fields = set(proprioception.Proprioception.__dataclass_fields__)
    assert fields == {"q", "qd", "torque", "press_n", "offset", "action", "lag", "phase"}
    assert set(depth_cameras.DepthImages.__dataclass_fields__) == {"depth_m", "kind"}


@pytest.mark.parametrize("layout", ["small", "paper"])
@pytest.mark.parametrize("seed", range(3))
def test_invisible_state_changes_no_bit(layout: str, seed: int) -> None:
    """Pose of an object inside the palm, velocity, spin, goal, mass, touched part, depth; the teacher's observation changes."""
    rng, core = np.random.default_rng(seed), worlds(crumb(), base="script", xy_m=0.02)
    core.step(rng.uniform(-1, 1, (1, 24)), rngs(core))
    look = StudentObserver(core, StudentSensors(eyes=CloudSampling(layout=layout)))
    look.observe()
    put(core, body=in_the_palm(core, seed))
    before, told = look.observe(), core.observe()
    state = core.state()
    put(core, body=in_the_palm(core, seed + 10), velocity=rng.normal(size=(1, 3)), spin=rng.normal(size=(1, 3)),
        force=state.force[..., ::-1].copy(), penetration_m=np.array([0.01]), contacts=np.array([7]))  # fmt: skip
    core._now.episode.goal[:] += 0.1
    core._now.episode.origin[:] += 0.1
    core.scenery.com[:] += 0.01
    after = look.observe()
    assert same(before, after)
    assert not np.array_equal(told, core.observe())
    core.close()


def test_visible_motion_changes_the_cloud() -> None:
    """An object moved by 2 cm in front of the cameras changes its part of the cloud, and nothing else."""
    core = worlds(base="script")
    look = StudentObserver(core, StudentSensors())
    look.observe()
    core.step(np.zeros((2, 24)), rngs(core))
    before = look.observe()
    put(core, body=core.state().body + np.array([0.02, 0, 0, 0, 0, 0, 0]))
    after = look.observe()
    core.close()
    assert np.array_equal(before.robot, after.robot) and np.array_equal(before.N, after.N)
    assert not np.array_equal(before.cloud[:, 256:], after.cloud[:, 256:])


def test_negative_points_stay_at_first_look_unless_tracked() -> None:
    """Tracking, as in the paper, needs the object's pose; the default does not."""
    core = worlds()
    first, tracked = StudentObserver(core, StudentSensors()), StudentObserver(core, StudentSensors(n_t="tracked"))
    before = first.observe().N, tracked.observe().N
    core.step(np.zeros((2, 24)), rngs(core))
    moved = core.state().body + np.array([0, 0, 0.1, 0, 0, 0, 0])
    put(core, body=moved)
    after = first.observe().N, tracked.observe().N
    core.close()
    assert after[0] == pytest.approx(before[0], abs=1e-3)
    assert after[1] - before[1] == pytest.approx(np.broadcast_to([0, 0, 0.1], after[1].shape), abs=2e-3)


def test_clouds_lie_on_hand_and_object() -> None:
    """The object's half is within 2 mm of the box of its hulls, the hand's near the palm's middle; on the axes of the start."""
    core = worlds(base="script")
    look = StudentObserver(core, StudentSensors())
    seen, points = look.observe(), [shape.at(pose) for shape, pose in zip(look.bodies, core.state().body, strict=True)]
    middle = look.robot.palm(core.state().q)[1]
    core.close()
    for k in range(2):
        c, s = np.cos(look.start.yaw[k]), np.sin(look.start.yaw[k])
        world = seen.cloud[k].astype(float) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle[k]
        low, high = points[k].min(0) - 0.002, points[k].max(0) + 0.002
        assert ((world[256:] >= low) & (world[256:] <= high)).all()
        assert np.linalg.norm(seen.cloud[k, :256].astype(float), axis=1).max() < 0.25
    assert seen.robot[:, -3:].tolist() == [[1, 1, 1], [1, 1, 1]]


def test_object_out_of_sight_gives_zeros() -> None:
    """The flags of visibility are 0, also without negative points."""
    core = worlds(held_by_handle())
    core.scenery.any_negative[:] = False
    put(core, body=core.state().body + np.array([9.0, 0, 0, 0, 0, 0, 0]))
    seen = StudentObserver(core, StudentSensors()).observe()
    core.close()
    assert not seen.cloud[:, 256:].any() and not seen.N.any() and seen.cloud[:, :256].any()
    assert seen.robot[0, -3:].tolist() == [1, 0, 0]


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_robot_blocks_need_no_object(layout: str) -> None:
    """The blocks R of every layout stay finite although all quantities of the object are NaN."""
    core = worlds(base="script")
    core.step(np.full((2, 24), 0.3), rngs(core))
    found = StudentObserver(core, StudentSensors(eyes=CloudSampling(layout=layout))).observe().robot
    core.close()
    assert found.shape == (2, sum(block.width for block in LAYOUTS[layout]["R"]) + 3)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("base", ["none", "script"])
@pytest.mark.parametrize("start", ["part", "anywhere"])
def test_actions_convert_to_the_start_frame_and_back(base: str, start: str) -> None:
    """The axes of the environment's actions are those of the start, rotated by one angle that is the same in every episode."""
    between = []
    for seed in range(4):
        core = worlds(base=base, start=start, seed=seed)
        look = StudentObserver(core, StudentSensors())
        look.observe()
        action = np.random.default_rng(seed).uniform(-1, 1, (2, 24))
        assert look.from_start_frame(look.to_start_frame(action)) == pytest.approx(action, abs=1e-12)
        moves = look.robot.to_world(look.to_start_frame(action), look.start)
        assert moves == pytest.approx(actions.turned(action * core.rates[:, 0], core.episode.yaw))
        between += list(np.exp(1j * (core.episode.yaw - look.start.yaw)))
        core.close()
    assert np.abs(np.array(between) - between[0]).max() < 1e-9


def test_depth_noise_in_randomised_worlds() -> None:
    """The same seed gives the same noise."""
    core = worlds(randomise=True)
    looks = [StudentObserver(core, StudentSensors(), seed) for seed in (1, 1, 2)]
    found = [look.observe().cloud for look in looks]
    core.close()
    assert all(one != DepthNoise() for one in looks[0].noise)
    assert np.array_equal(found[0], found[1]) and not np.array_equal(found[0], found[2])


def test_farthest_point_sampling_spreads_points() -> None:
    """Points are farther apart than pixels at even intervals; both samples have the requested size."""
    core = worlds(held_by_handle())
    observers = [StudentObserver(core, StudentSensors(eyes=CloudSampling(64, sampling))) for sampling in SAMPLINGS]
    clouds = [one.observe().cloud[0, 32:].astype(float) for one in observers]
    core.close()
    gaps = [np.sort(np.linalg.norm(one[:, None] - one[None], axis=2), axis=1)[:, 1].min() for one in clouds]
    assert clouds[0].shape == clouds[1].shape == (32, 3)
    assert gaps[1] > 2 * gaps[0]


@pytest.mark.parametrize(("make", "wrong"), [
    (StudentSensors, {"n_t": "guessed"}), (CloudSampling, {"points": 3}), (CloudSampling, {"sampling": "random"})])  # fmt: skip
def test_wrong_sensors_are_refused(make: Any, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}: expected"):
        make(**wrong)
