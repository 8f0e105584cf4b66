"""Stage grasp_student: files of a teacher in, of a student out; exact resumption; errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import block_slices, obs_blocks
from afford.grasping.env.rollout import rollout
from afford.grasping.env.scenery import to_frame
from afford.grasping.env.task import from_grasp_task
from afford.grasping.hand.kinematics import joint_limits
from afford.grasping.policies import load_policy, train_student
from afford.grasping.policies.depth_cameras import CameraRig
from afford.grasping.policies.student import StudentSensors
from afford.grasping.policies.student_obs import CloudSampling
from afford.grasping.rl.cloud_policy import CloudPolicy
from afford.grasping.rl.estimating_policy import FRAME, EstimatingPolicy
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from afford.grasping.sim.scene import Physics
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.mesh import ObjectSpec
from schemas.training import Trained
from stages.grasping import grasp_student, grasp_tasks
from tests.helpers.made_hands import shadow
from tests.helpers.made_samples import Scratch
from tests.helpers.made_scenes import tool
from tests.helpers.made_students import rngs, teacher

TINY = grasp_student.Params(rounds=3, worlds=2, updates=2, batch=8, buffer=60, led=1, size_px=32, points=32)


def tasks() -> tuple[GraspTask, ...]:
    specs = [ObjectSpec(kind, kind, 12, "plain", "train") for kind in ("screwdriver", "spatula")]
    return tuple(grasp_tasks.run(one, tool(one.category, 12), grasp_tasks.Params(within_m=1.0))[0] for one in specs)


class Killed(Scratch):
    """A run that dies when it has come so far."""

    def progress(self, done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def expert(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return teacher(tmp_path_factory.mktemp("teacher"))


@pytest.fixture(scope="module")
def trained(expert: FileTree, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return grasp_student.run(shadow(), (tasks(),), expert, TINY, Scratch(tmp_path_factory.mktemp("student")))


def test_student_files_can_be_loaded_and_act(trained: Trained) -> None:
    """Play episodes in the environment of its teacher, in another engine."""
    policy = load_policy.load_policy(trained.files, {})
    config = policy.config("bullet", Physics(), "flat", 0.0)
    assert (config.start, config.base, policy.student is not None) == ("anywhere", "script", True)
    grasping = GraspWorlds(shadow(), [from_grasp_task(one) for one in tasks()], config)
    rounds = [rollout(grasping, policy.actor(grasping), rngs(grasping, seed)) for seed in (0, 0, 1)]
    grasping.close()
    assert np.isfinite(rounds[0].action).all() and rounds[0].action.any()
    assert np.array_equal(rounds[0].q, rounds[1].q) and not np.array_equal(rounds[0].q, rounds[2].q)


def test_curves_of_a_training(trained: Trained) -> None:
    """The error of every round, the teacher's share, and figures of the student's own episodes."""
    curves = {one.name: one for one in trained.log.curves}
    assert {"train.error", "train.led", "train.held"} <= set(curves)
    assert curves["train.error"].step.tolist() == [1, 2, 3] and trained.log.steps == 3
    assert curves["train.led"].value.tolist() == [1.0, 0.0, 0.0]


def test_killed_training_resumes_to_the_same_bytes(trained: Trained, expert: FileTree, tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Resumes from the last checkpoint; replay buffers of older ones are deleted."""
    monkeypatch.setattr(train_student, "SECTION", 1)
    with pytest.raises(KeyboardInterrupt):
        grasp_student.run(shadow(), (tasks(),), expert, TINY, Killed(tmp_path))
    assert [path.name for path in tmp_path.glob("moments-*")] == ["moments-2.safetensors"]
    again = grasp_student.run(shadow(), (tasks(),), expert, TINY, Scratch(tmp_path))
    assert [(one.name, one.digest) for one in again.files.files] == [(one.name, one.digest) for one in trained.files.files]


def test_missing_teacher_or_tasks_are_refused(trained: Trained, expert: FileTree, tmp_path: Path) -> None:
    for given, some in ((FileTree("none", ()), tasks()), (trained.files, tasks()), (expert, ())):
        with pytest.raises(ValueError, match="expected a task or more and the files of a teacher"):
            grasp_student.run(shadow(), (some,), given, TINY, Scratch(tmp_path))


def test_incomplete_student_files_are_refused(trained: Trained) -> None:
    """The error names the missing file."""
    config = trained.files.find("student.json")
    assert config is not None
    with pytest.raises(ValueError, match=r"student: expected student\.safetensors of a trained student, got student\.json"):
        load_policy.load_policy(FileTree("student", (config,)), {})


def test_perturbed_hands_have_other_fingers_alone(expert: FileTree, tmp_path: Path) -> None:
    """Wrist and object stay, joints are within their limits, teacher and student observe the same; the episode stays as it was."""
    policy, recorder = load_policy.load_policy(expert, {}), FlightRecorder(tmp_path, "mujoco", 0)
    chosen = [from_grasp_task(one) for one in tasks()]
    core = train_student.DistillationWorlds(shadow(), chosen, policy.config("mujoco", Physics(), "flat", 0.0), recorder)
    envs = train_student.DistillationEnv(core, policy.actor(core), StudentSensors(CameraRig(1, 32), CloudSampling(32)), recorder)
    before, state, label = envs.begin(0), core.state(), envs.label()
    seen, other = envs.perturbed(np.random.default_rng(0))
    again = envs.perturbed(np.random.default_rng(0))
    displaced = train_student.perturbed(state, shadow(), np.random.default_rng(0))
    assert core.state() is state and np.array_equal(envs.label(), label)
    assert all(np.array_equal(one, two) for one, two in zip(envs.observer.observe(), before, strict=True))
    lower, upper = joint_limits(shadow().joints).T
    assert np.array_equal(displaced.q[:, :6], state.q[:, :6]) and (displaced.q[:, 6:] != state.q[:, 6:]).any(axis=1).all()
    assert (displaced.q[:, 6:] >= lower[6:]).all() and (displaced.q[:, 6:] <= upper[6:]).all()
    assert np.array_equal(displaced.body, state.body) and np.array_equal(displaced.palm, state.palm)
    with core.observed_as(displaced):
        assert np.array_equal(envs.label(), other)
    assert not np.array_equal(seen.robot, before.robot) and not np.array_equal(other, label)
    assert np.array_equal(seen.N, before.N) and all(np.array_equal(one, two) for one, two in zip(seen, again[0], strict=True))
    core.close()


def untrained_prior() -> ActorCritic:
    torch.manual_seed(1)
    made = ActorCritic(PolicyConfig(sum(block.width for block in obs_blocks("small", "prior")), 24, (16,)))
    torch.nn.init.normal_(list(made.actor.parameters())[-2], std=0.3)
    return made


@pytest.fixture
def envs(expert: FileTree, tmp_path: Path) -> Iterator[train_student.DistillationEnv]:
    """Worlds whose labels have what the teacher observes."""
    policy, recorder = load_policy.load_policy(expert, {}), FlightRecorder(tmp_path, "mujoco", 0)
    chosen = [from_grasp_task(one) for one in tasks()]
    core = train_student.DistillationWorlds(shadow(), chosen, policy.config("mujoco", Physics(), "flat", 0.0), recorder)
    sensors = StudentSensors(CameraRig(1, 32), CloudSampling(32))
    yield train_student.DistillationEnv(core, policy.actor(core), sensors, recorder, observed=True)
    core.close()


def estimating(envs: train_student.DistillationEnv, robot: np.ndarray) -> EstimatingPolicy:
    found = train_student.new_student("small", robot.shape[1], envs.core.motors, 0, train_student.teacher_copy(envs))
    assert isinstance(found, EstimatingPolicy)
    return found


@pytest.mark.parametrize("prior", [None, untrained_prior()], ids=["alone", "with_prior"])
def test_true_estimates_give_the_actions_of_the_teacher(envs: train_student.DistillationEnv, prior: ActorCritic | None) -> None:
    """Compare them at every step, along the axes of the start, also in perturbed states."""
    assert isinstance(envs.teacher, load_policy.MeanAction)
    envs.teacher.prior = prior
    obs, motors = envs.begin(0), envs.core.motors
    model = estimating(envs, obs.robot)
    for step in range(12):
        label = envs.label()
        for seen, wanted in ((obs, label), envs.perturbed(np.random.default_rng(step))):
            action = model.act(torch.as_tensor(seen.robot), torch.as_tensor(wanted[:, motors:], dtype=torch.float32))
            assert np.allclose(action.numpy(), wanted[:, :motors], atol=2e-4) and wanted[:, :motors].any()
        obs = envs.step(label[:, :motors])


def test_clouds_of_the_whole_surface_are_measured_as_the_teacher_observes_them(envs: train_student.DistillationEnv) -> None:
    """Read numbers of P and N from clouds and the frame alone, without training; N_t follows the object's centre of mass."""
    obs, core = envs.begin(0), envs.core
    model, start, lift = estimating(envs, obs.robot), envs.observer.start, np.array([0.0, 0.0, 0.1])
    scenery, middle = core.scenery, core.scenery.palm(core.state())[:, None]
    before, points = (to_frame(where(core.state()) - middle, start.yaw) for where in (scenery.negative_points, scenery.points))
    state = replace(core.state(), body=core.state().body + np.concatenate([lift, np.zeros(4)]))
    with core.observed_as(state):
        label = torch.as_tensor(envs.label()[:, core.motors :], dtype=torch.float32)
    cloud = torch.as_tensor(np.concatenate([np.zeros_like(points), points + lift], axis=1))
    found = model._measured(torch.as_tensor(obs.robot), cloud, torch.as_tensor(before), label) + model._units()[0][FRAME:]
    at = block_slices(obs_blocks("small", "teacher"))
    for name in ("whole", "tips_object", "to_surface", "negative", "tips_N"):
        columns = slice(at[name].start - model.own, at[name].stop - model.own)
        assert torch.allclose(found[:, columns], label[:, FRAME:][:, columns], atol=1e-4), name


def test_a_student_of_its_own_network_needs_no_copy(trained: Trained, expert: FileTree, tmp_path: Path) -> None:
    """Its files have no networks of the teacher; a teacher of another layout has a student of this kind only."""
    own = grasp_student.run(shadow(), (tasks(),), expert, replace(TINY, head="own", rounds=1), Scratch(tmp_path / "own"))
    policies = [load_policy.load_policy(one.files, {}).student for one in (own, trained)]
    assert [type(one.model) for one in policies if one] == [CloudPolicy, EstimatingPolicy]
    other = teacher(tmp_path / "teacher", layout="paper")
    with pytest.raises(ValueError, match=r"expected a teacher of layout=small, action_mode=rate, got paper, rate; .*head=own"):
        grasp_student.run(shadow(), (tasks(),), other, TINY, Scratch(tmp_path / "paper"))
    with pytest.raises(ValueError, match="expected the robot's own numbers in the layout small, 96 and 3 flags, got 194"):
        grasp_student.run(shadow(), (tasks(),), expert, replace(TINY, layout="paper"), Scratch(tmp_path / "layout"))
    with pytest.raises(ValueError, match="expected a head of teacher, own, got 'two'"):
        grasp_student.run(shadow(), (tasks(),), expert, replace(TINY, head="two"), Scratch(tmp_path / "two"))
