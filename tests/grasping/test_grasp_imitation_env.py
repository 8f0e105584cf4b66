"""Grasp imitation: human grasps along an object, and the worlds in which a hand follows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import obs_blocks
from afford.grasping.env.scenery import to_frame
from afford.grasping.env.task import make_task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.clip_filter import held_counts
from afford.grasping.sim.scripted import Aim
from schemas.hand import PHASES
from stages.grasping import grasp_targets
from tests.helpers.made_hands import shadow
from tests.helpers.made_priors import TOOLS, reference_set, rehearsing, targets
from tests.helpers.made_scenes import tool


def test_targets_lie_in_the_object() -> None:
    """The handle is across x, amid surface points, off the ends; the centre of mass above the origin; every second one turned."""
    body = tool("spatula")
    found = grasp_targets.run(body, shadow(), grasp_targets.Params(places=4))
    ways = list[Rotation]()
    for one in found:
        turn = Rotation.from_quat(one.object_pose[3:])
        spots, handle = turn.apply(body.points.astype(float)) + one.object_pose[:3], np.eye(4)
        handle[:3, :3], handle[:3, 3] = turn.as_matrix(), one.object_pose[:3]
        handle = handle @ one.T_object_handle
        assert handle[:3, 2] == pytest.approx([1, 0, 0], abs=1e-9)
        assert (turn.apply(np.array(body.com_m)) + one.object_pose[:3])[:2] == pytest.approx([0, 0], abs=1e-9)
        assert (spots.min(0) < handle[:3, 3]).all() and (handle[:3, 3] < spots.max(0)).all()
        assert min(np.ptp(spots[:, 1:], axis=0)) / 4 < one.diameter_m <= np.ptp(spots[:, 1])
        ways.append(turn)
    assert np.abs((ways[1] * ways[0].inv()).as_rotvec()) == pytest.approx([0, 0, np.pi], abs=1e-6)
    assert (ways[2] * ways[0].inv()).magnitude() == pytest.approx(0, abs=1e-6)
    again, other = (grasp_targets.run(body, shadow(), grasp_targets.Params(places=4, seed=seed)) for seed in (0, 1))
    assert all(np.array_equal(a.T_object_handle, b.T_object_handle) for a, b in zip(found, again, strict=True))
    assert not np.array_equal(found[0].T_object_handle, other[0].T_object_handle)


def test_references_begin_above_and_end_lifted() -> None:
    """8 to 16 cm above the pinch, within 4 cm of the vertical; fingers bend by a radian or more; the object ends 20 cm higher."""
    for one in reference_set().references:
        last_of_reach = int(np.flatnonzero(one.phase == PHASES.index("reach"))[-1])
        way = one.T_world_palm[0, :3, 3] - one.T_world_palm[last_of_reach, :3, 3]
        assert 0.08 < way[2] < 0.16 and np.linalg.norm(way[:2]) < 0.04
        assert one.object_pose[-1, 2] - one.object_pose[0, 2] == pytest.approx(0.2, abs=1e-3)
        assert len(one.q) / one.rate_hz <= 2.0
        assert one.q[-1, 6:].sum() > one.q[0, 6:].sum() + 1.0


def test_observation_equals_that_of_role_prior() -> None:
    """AffordanceGrasp with the role prior gives the same observation in the same state."""
    made = rehearsing()
    rngs = [np.random.default_rng(k) for k in range(2)]
    made.reset(range(2), rngs)
    for _ in range(12):
        made.step(made.expert(), rngs)
    other = GraspWorlds(shadow(), [make_task(tool(name)) for name in TOOLS], made.grasping.config)
    other.restore(made.grasping.save())
    assert made.observe().shape == (2, sum(block.width for block in obs_blocks("small", "prior")))
    assert np.array_equal(made.observe(), other.observe())
    action = np.full((2, 24), 0.3)
    assert np.array_equal(made.step(action, rngs).success, other.step(action, rngs).success)
    assert np.array_equal(made.observe(), other.observe())
    made.close()
    other.close()


def test_expert_lifts_and_tracks() -> None:
    """Clips hold their object at the end in most episodes; level 1 is tracked within 2 cm; the clip filter agrees."""
    made = rehearsing()
    good, level_1 = list[float](), list[float]()
    for episode in range(3):
        rngs = [np.random.default_rng([episode, k]) for k in range(2)]
        made.reset(range(2), rngs)
        for _ in range(made.config.steps):
            made.step(made.expert(), rngs)
        report = made.report()
        good += report["held"].tolist()
        level_1 += report["level_1_m"].tolist()
    made.close()
    assert np.mean(good) >= 0.5
    assert np.mean(level_1) < 0.02
    clips = reference_set().references
    found = held_counts(shadow(), [make_task(tool(name)) for name in TOOLS], clips, made.config, 1, 4, 0)
    assert found.shape == (len(clips),) and found.sum() >= len(clips) / 2


def test_expert_does_not_pull_back_along_the_object() -> None:
    """The expert descends at a displacement of 4 cm: its action along x is unchanged, that across leads back."""
    made = rehearsing()
    for along, across in ((0.04, 0.0), (0.0, 0.04)):
        rngs = [np.random.default_rng(k) for k in range(2)]
        made.reset(range(2), rngs)
        plain = made.expert()
        moves = np.zeros((2, 24))
        moves[:, :2] = along / 0.03, across / 0.03
        for _ in range(2):
            made.step(made.expert() + moves / 2, rngs)
        assert np.abs(made.expert()[:, 0] - plain[:, 0]).max() < 0.2
        assert (made.expert()[:, 1] < -0.5).all() == bool(across)
    made.close()


def test_clip_is_rotated_and_shifted_with_its_object() -> None:
    """The pose of the palm relative to the object is that of the clip, at every yaw and place."""
    made, clips = rehearsing(), reference_set().references
    rngs = [np.random.default_rng(k) for k in range(2)]
    made.reset(range(2), rngs)
    for k in range(2):
        clip = clips[made._now.clip[k]]
        episode, state = made.grasping.episode, made.state()
        palm = to_frame((state.palm[k, :3] - episode.origin[k])[None, None], episode.yaw[k : k + 1])[0, 0]
        turn, com_m = Rotation.from_quat(clip.object_pose[0, 3:]), np.array(made.grasping.tasks[k].body.com_m)
        com = turn.apply(com_m) + clip.object_pose[0, :3]
        assert palm == pytest.approx(clip.T_world_palm[0, :3, 3] - com, abs=2e-3)
        assert made.tracking().wrist_m[k] < 2e-3 and made.tracking().wrist_rad[k] < 2e-2
    made.close()


def test_same_seed_same_trajectory_and_restore() -> None:
    """Equal bit for bit."""
    made = rehearsing(shift_m=0.02, astray=(0.005, 0.02, 0.02))

    def run(seed: int, steps: int) -> np.ndarray:
        rngs = [np.random.default_rng([seed, k]) for k in range(2)]
        made.reset(range(2), rngs)
        return np.stack([(made.step(made.expert(), rngs), made.observe())[1] for _ in range(steps)])

    first, other = run(0, 6), run(1, 6)
    assert np.array_equal(first, run(0, 6))
    assert not np.array_equal(first, other)
    token, rngs = made.save(), [np.random.default_rng(k) for k in range(2)]
    made.step(np.ones((2, 24)), rngs)
    after = made.observe()
    run(3, 2)
    made.restore(token)
    made.step(np.ones((2, 24)), rngs)
    assert np.array_equal(after, made.observe())
    made.close()


def test_missing_clips_and_posture_are_refused() -> None:
    """An object without a clip; a base that needs a posture."""
    with pytest.raises(ValueError, match="a clip that grasps hammer"):
        type(rehearsing())(shadow(), [make_task(tool("hammer"))], reference_set().references, rehearsing().config)
    with pytest.raises(ValueError, match="posture"):
        replace(rehearsing().grasping.config, posture=())


def test_prior_begins_over_the_aim() -> None:
    """A posture is relative to the aim: rotated with it and shifted to its place, with the same fingers."""
    made = rehearsing()
    posture = np.arange(24) / 100
    for yaw in (0.0, 0.7):
        made.grasping.begin([0], [targets()[0].object_pose], [Aim(np.array([0.1, 0.2, 0.03]), yaw)], [tuple(posture)])
        u = made.state().q[0][commanded_columns(shadow().joints)]
        wrist = Rotation.from_euler("z", yaw).apply(posture[:3]) + (0.1, 0.2, 0.03)
        assert u[:3] == pytest.approx(wrist)
        assert u[3] == pytest.approx(posture[3] + yaw)
        assert u[4:] == pytest.approx(posture[4:])
    made.close()
