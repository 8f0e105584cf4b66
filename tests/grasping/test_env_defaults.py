"""Environment without arguments: gymnasium's checks, frames, films, registration, short reprs."""

from __future__ import annotations

import importlib.util
import site
import subprocess
import sys
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo, RenderCollection

from afford.environments import ENVIRONMENTS, register
from afford.grasping.env import default
from afford.grasping.env import env as env_module
from afford.grasping.env.env import HEIGHT, ID, WIDTH, AffordanceGrasp, grasp_task
from afford.grasping.env.task import from_grasp_task
from schemas.mesh import PartedMesh
from schemas.video import Clip
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import block

LONGEST = 900
"""characters of a repr"""


@pytest.fixture
def small_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Render few pixels, where only the number and kind of frames matter."""
    monkeypatch.setattr(env_module, "WIDTH", 64)
    monkeypatch.setattr(env_module, "HEIGHT", 48)


@cache
def default_hammer() -> PartedMesh:
    """The default tool, as the stage object_build makes it."""
    return object_build.run(default.TOOL, object_build.Params(atlas_px=64))


def drawn(**config: object) -> AffordanceGrasp:
    """One world that draws."""
    made = gymnasium.make(ID, render_mode="rgb_array", **config).unwrapped
    assert isinstance(made, AffordanceGrasp)
    return made


@pytest.mark.usefixtures("small_frames")
def test_check_env_with_frames() -> None:
    """check_env, including its checks of render."""
    made = drawn(steps=6)
    check_env(made)
    made.close()


def test_frames_show_the_current_state() -> None:
    """(h, w, 3) uint8; the same state gives the same frame, a moved hand another one, and drawing does not change the state."""
    made, blind = drawn(), gymnasium.make(ID)
    first, _ = made.reset(seed=3)
    frame = made.render()
    assert frame is not None and frame.shape == (HEIGHT, WIDTH, 3) and frame.dtype == np.uint8 and np.ptp(frame) > 100
    assert np.array_equal(frame, made.render())
    assert np.array_equal(first, blind.reset(seed=3)[0])
    up = np.eye(24)[2]
    assert np.array_equal(made.step(up)[0], blind.step(up)[0])
    moved = made.render()
    assert moved is not None and (frame != moved).any()
    assert blind.unwrapped.render() is None
    made.close()
    blind.close()


@pytest.mark.usefixtures("small_frames")
def test_render_fps_is_the_rate_of_control() -> None:
    """Count the frames of gymnasium's RenderCollection; 20 per second, 60 with the paper's actions."""
    made = RenderCollection(gymnasium.make(ID, render_mode="rgb_array"))
    made.reset(seed=0)
    for _ in range(3):
        made.step(np.zeros(24))
    assert len(made.render()) == 4
    assert made.unwrapped.metadata["render_fps"] == 20
    made.close()
    paper = drawn(action_mode="paper", steps=200)
    assert paper.metadata["render_fps"] == 60
    paper.close()


@pytest.mark.usefixtures("small_frames")
@pytest.mark.skipif(importlib.util.find_spec("moviepy") is None, reason="RecordVideo writes with moviepy, which `EXTRA=film` adds")
def test_record_video(tmp_path: Path) -> None:
    """RecordVideo writes an episode."""
    made = RecordVideo(gymnasium.make(ID, render_mode="rgb_array", steps=4), str(tmp_path / "films"), disable_logger=True)
    made.reset(seed=0)
    for _ in range(4):
        made.step(np.zeros(24))
    made.close()
    assert [path.stat().st_size > 0 for path in tmp_path.glob("films/*.mp4")] == [True]


def test_wrong_render_calls_are_refused() -> None:
    """Another mode, and a frame before the first reset."""
    with pytest.raises(ValueError, match="expected rgb_array or None, got 'human'"):
        AffordanceGrasp(render_mode="human")
    made = drawn()
    with pytest.raises(RuntimeError, match=r"call reset\(\) before"):
        made.render()
    made.close()


def test_default_hand_and_task_equal_those_of_the_stages() -> None:
    """The hand bit for bit, the hammer by its mass and parts; the scripted grasp succeeds by the handle."""
    assert repr(default.hand()) == repr(shadow()) and default.hand().urdf == shadow().urdf
    built = default_hammer()
    body = object_solids.run(built.mesh, built.parts, object_solids.Params())
    assert np.array_equal(body.corners, default.tool().body.corners) and body.mass_kg == default.tool().body.mass_kg
    assert hand_model.Params().wrist == "gantry"
    made = gymnasium.make(ID, base="script")
    made.reset(seed=0)
    over = False
    while not over:
        *_, over, info = made.step(np.zeros(24))
    assert info["report"]["success"] == 1.0 and info["report"]["negative_contact_end"] == 0.0
    made.close()


def test_task_survives_conversion_to_grasp_task() -> None:
    """Frames are drawn of the task itself."""
    task = default.tool()
    again = from_grasp_task(grasp_task(task))
    assert again.hold == task.hold and np.array_equal(again.negative, task.negative) and np.array_equal(again.N_t, task.N_t)


def test_names_are_registered_once() -> None:
    """A second registration does nothing; every entry point exists and is that of the table, also in an installed afford."""
    before = {name: gymnasium.registry[name] for name in ENVIRONMENTS}
    assert {name: (one.entry_point, one.vector_entry_point) for name, one in before.items()} == ENVIRONMENTS
    register()
    assert {name: gymnasium.registry[name] for name in ENVIRONMENTS} == before
    for spec in before.values():
        assert callable(gymnasium.envs.registration.load_env_creator(spec.entry_point))
        assert callable(gymnasium.envs.registration.load_env_creator(spec.vector_entry_point))


def test_import_registers_the_environments() -> None:
    """Import with -S, which leaves out the registration in site-packages, as if afford were not installed."""
    code = ("import sys; sys.path[:0] = sys.argv[1:]; import gymnasium; from afford.environments import ENVIRONMENTS as known\n"
            "assert not known.keys() & gymnasium.registry.keys()\n"
            "import afford.grasping.env.env, afford.grasping.imitation.imitate_env\n"
            "found = {name: gymnasium.registry[name] for name in known}\n"
            "assert {name: (one.entry_point, one.vector_entry_point) for name, one in found.items()} == known")
    path = [str(Path(__file__).resolve().parents[2]), *site.getsitepackages()]
    done = subprocess.run([sys.executable, "-S", "-c", code, *path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_reprs_are_short() -> None:
    """Shapes instead of arrays, for schemas, tasks and environments; fields are still named."""
    built = default_hammer()
    made = gymnasium.make(ID)
    for thing in (default.hand(), block(), built.mesh, built.parts, built, default.tool(), made, made.unwrapped):
        assert len(repr(thing)) < LONGEST and "\n" not in repr(thing), type(thing)
    assert "vertices=float32 (" in repr(built.mesh) and repr(built).startswith("PartedMesh(mesh=ObjectMesh('hammer')")
    assert repr(default.tool()) == "Task('hammer', hold='handle', negative=['head', 'face', 'claw'])"
    assert "hammer by its handle" in repr(made.unwrapped)
    assert Clip.__repr__ is block().__class__.__repr__
    made.close()
