"""Flight recorder: last states of diverged worlds, runs that go on, and trainings that count divergences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.common.files import tree
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.flight_recorder import OBJECT_M_S, STEPS, FlightRecorder, diverged
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.policies.train_teacher import TeacherTrainingConfig, export_teacher, train_teacher
from afford.grasping.rl.ppo import PPOConfig
from afford.grasping.sim.engine import DivergedError, State
from afford.grasping.sim.worlds import ThreadWorlds
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow

HUGE = np.array([[1e13, 0.0, 0.0]])
"""force that no solver follows, N"""


def begun(recorder: FlightRecorder | None, engine: str = "mujoco") -> tuple[GraspWorlds, list[np.random.Generator]]:
    made = GraspWorlds(shadow(), [held_by_handle()] * 2, GraspEnvConfig(engine=engine), recorder)
    rngs = [np.random.default_rng(k) for k in range(2)]
    made.reset(range(2), rngs)
    return made, rngs


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_last_states_of_a_diverged_world_are_written(engine: str, tmp_path: Path) -> None:
    """Its twenty last steps, the last of which shows the divergence; the other world is the same as without it."""
    recorder = FlightRecorder(tmp_path, engine, seed=7)
    made, rngs = begun(recorder, engine)
    quiet, others = begun(None, engine)
    recorder.begin(3)
    action = np.linspace(-0.1, 0.1, 48).reshape(2, 24)
    for step in range(STEPS + 3):
        if step == STEPS + 1:
            made.worlds.push(HUGE, 0.05, [1])
        out = made.step(action, rngs)
        quiet.step(action, others)
        assert out.terminated.tolist() == [False, step == STEPS + 1]
        assert np.isfinite(made.observe()).all() and np.isfinite(out.reward).all()
    assert np.array_equal(made.state().q[0], quiet.state().q[0])
    (path,) = (tmp_path / "diverged").iterdir()
    with np.load(path) as kept:
        assert (int(kept["world"]), int(kept["seed"]), int(kept["part"]), str(kept["engine"])) == (1, 7, 3, engine)
        assert str(kept["task"]) == f"{made.tasks[1].body.name}/handle"
        assert kept["step"].tolist() == list(range(2, STEPS + 2))
        assert kept["q"].shape == (STEPS, made.state().q.shape[1]) and kept["body"].shape == (STEPS, 7)
        assert kept["force"].shape[:2] == (STEPS, 6)
        assert (kept["action"] == action[1]).all()
        assert (np.abs(kept["velocity"][:-1]) < 1).all() and not (np.abs(kept["velocity"][-1]) <= OBJECT_M_S).all()
    assert recorder.take_count() == {"diverged": 1.0} and recorder.take_count() == {}
    made.close()
    quiet.close()


def test_divergence_without_a_recorder_is_an_error() -> None:
    """The error names the object and the engine; a world that is reset goes on."""
    made, rngs = begun(None)
    made.worlds.push(HUGE, 0.05, [1])
    with pytest.raises(DivergedError, match=r"mujoco diverged in world 1.*a rate above 240 Hz"):
        made.step(np.zeros((2, 24)), rngs)
    made.reset(range(2), rngs)
    assert not diverged(made.state()).any()
    made.close()


def test_training_goes_on_and_reports_divergences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A world whose joints get a huge velocity in the third step: a curve, a file in the output, finite weights."""
    real, steps = ThreadWorlds.step, list[int]()

    def step(self: ThreadWorlds, u: np.ndarray, control_s: float) -> State:
        steps.append(1)
        if len(steps) == 3:
            self.worlds[0]._data.qvel[:] = 1e12  # type: ignore[attr-defined]  # of a MujocoWorld
        return real(self, u, control_s)

    monkeypatch.setattr(ThreadWorlds, "step", step)
    plan = TeacherTrainingConfig(0, 2, "small", 0.1, 0.3, PPOConfig(updates=2, steps=4, epochs=1))
    config = GraspEnvConfig(base="none", start="anywhere", steps=4, reward="dense")
    model, state = train_teacher(shadow(), [held_by_handle()], None, config, plan, tmp_path, lambda done, total: None)
    assert [(point.step, point.value) for point in state.points if point.name == "train.diverged"] == [(1, 1.0)]
    assert all(bool(parameter.isfinite().all()) for parameter in model.parameters())
    names = [file.name for file in tree("teacher", export_teacher(tmp_path, model, None, config, 0)).files]
    assert [name for name in names if "diverged" in name] == ["diverged/00000-0003-world-0.npz"]
