"""Observation blocks: widths, dependence on roles, invariance to the orientation of the table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.env.obs_blocks import LAYOUTS, ROLES, Snapshot, block_slices, obs_blocks, observe
from afford.grasping.env.scenery import EpisodeFrame, to_frame
from tests.helpers.made_grasps import env

ACTIONS = np.random.default_rng(0).uniform(-0.5, 0.5, (6, 24)).astype(np.float32)


def moment() -> Snapshot:
    """Make a snapshot in the middle of an episode."""
    made = env(base="script")
    made.reset(seed=3)
    for action in ACTIONS:
        made.step(action)
    core = made.core
    now, state = core._now, core.state()
    out = Snapshot(core.scenery, now.episode, state, core.measures(), now.action, now.offset, now.offset, np.array([0.2]))
    made.close()
    return out


def test_paper_layout_has_300_numbers() -> None:
    """The published order; the teacher has 300 more for N_t, the student no state of the object."""
    chosen = obs_blocks("paper", "prior")
    at = block_slices(chosen)
    names = ("q", "qd", "torque", "tips", "tip_force", "palm", "action", "object", "unused", "feature")
    assert [at[name].start for name in names] == [0, 22, 44, 66, 131, 161, 167, 191, 207, 236]
    assert sum(block.width for block in chosen) == 300
    assert sum(block.width for block in obs_blocks("paper", "teacher")) == 600
    assert "object" not in block_slices(obs_blocks("paper", "student"))


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_blocks_have_their_declared_width(layout: str) -> None:
    """Finite in every role, with the blocks of the role."""
    now = moment()
    for role, groups in ROLES.items():
        found = observe(obs_blocks(layout, role), now)
        assert found.dtype == np.float32
        assert found.shape == (1, sum(block.width for group in groups for block in LAYOUTS[layout][group]))
        assert np.isfinite(found).all()


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_observations_are_invariant_to_the_frame_of_the_table(layout: str) -> None:
    """A state that is rotated about the vertical and moved along the table gives the same observation."""
    now, turn, shift = moment(), Rotation.from_euler("z", 0.9), np.array([0.2, -0.1, 0.0])
    state, episode = now.state, now.episode

    def pose(old: np.ndarray) -> np.ndarray:
        return np.concatenate([turn.apply(old[:, :3]) + shift, (turn * Rotation.from_quat(old[:, 3:])).as_quat()], axis=1)

    q, qd = state.q.copy(), state.qd.copy()
    q[:, :3], q[:, 3] = turn.apply(q[:, :3]) + shift, q[:, 3] + 0.9
    qd[:, :3] = turn.apply(qd[:, :3])
    turned = replace(
        now, episode=EpisodeFrame(turn.apply(episode.origin) + shift, episode.yaw + 0.9, turn.apply(episode.goal) + shift),
        state=replace(state, q=q, qd=qd, tips=turn.apply(state.tips[0])[None] + shift, palm=pose(state.palm), body=pose(state.body),
                      velocity=turn.apply(state.velocity), spin=turn.apply(state.spin)))  # fmt: skip
    chosen = obs_blocks(layout, "teacher")
    before, after = observe(chosen, now), observe(chosen, turned)
    signs = block_slices(chosen)
    for name, at in signs.items():
        one, other = before[0, at], after[0, at]
        if layout != "small" and name in ("tips", "object"):  # a quaternion and its negative are one rotation
            one, other = np.abs(one), np.abs(other)
        assert other == pytest.approx(one, abs=1e-5), name


def test_teacher_alone_observes_negative_points() -> None:
    """Other N_t change the teacher's observation, not the prior's."""
    now = moment()
    other = replace(now, scenery=replace(now.scenery, N_object=now.scenery.N_object + 0.02))
    for role, same in (("prior", True), ("teacher", False), ("student", False)):
        chosen = obs_blocks("small", role)
        assert np.array_equal(observe(chosen, now), observe(chosen, other)) == same


def test_fingertip_velocities_equal_finite_differences() -> None:
    """The paper's block, by differences of kinematics, in the yaw of the palm."""
    from afford.grasping.hand.kinematics import forward_kinematics, points_on_links

    now = moment()
    hand, h = now.scenery.hand, 1e-6
    poses = [forward_kinematics(hand.joints, q) for q in (now.state.q, now.state.q + h * now.state.qd)]
    tips = [points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m) for T in poses]
    speed = to_frame((tips[1] - tips[0]) / h, now.palm_yaw)[0]
    block = observe(obs_blocks("paper", "prior"), now)[0, 66:131].reshape(5, 13)
    assert block[:, 7:10] == pytest.approx(speed, abs=1e-4)
    assert np.linalg.norm(block[:, 3:7], axis=1) == pytest.approx(1.0)


def test_unknown_layouts_and_roles_are_refused() -> None:
    """ValueError for each."""
    with pytest.raises(ValueError, match="got 'big' and 'teacher'"):
        obs_blocks("big", "teacher")
    with pytest.raises(ValueError, match="'pupil'"):
        obs_blocks("small", "pupil")
