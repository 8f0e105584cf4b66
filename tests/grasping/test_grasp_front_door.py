"""The environment without arguments: gymnasium's checks, frames, films, and reprs that one can read."""

from __future__ import annotations

import importlib.util
import site
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo, RenderCollection

from afford.environments import ENVIRONMENTS, register
from afford.grasping.env import default
from afford.grasping.env.env import HEIGHT, ID, WIDTH, AffordanceGrasp, grasp_task
from afford.grasping.env.task import from_grasp_task
from schemas.video import Clip
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import block

LONGEST = 900
"""characters of a repr"""


def drawn(**config: object) -> AffordanceGrasp:
    """One world that draws."""
    made = gymnasium.make(ID, render_mode="rgb_array", **config).unwrapped
    assert isinstance(made, AffordanceGrasp)
    return made


def test_gymnasium_finds_no_fault_with_it() -> None:
    """check_env, its frames included."""
    made = drawn(steps=6)
    check_env(made)
    made.close()


def test_frames_are_pictures_of_now() -> None:
    """(h, w, 3) uint8; the same state is the same picture, a moved hand another one, and the state is not touched by drawing."""
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


def test_frames_are_collected_at_the_rate_of_control() -> None:
    """By gymnasium's own wrapper; 20 a second, 60 with the paper's actions."""
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


@pytest.mark.skipif(importlib.util.find_spec("moviepy") is None, reason="RecordVideo writes with moviepy, which `EXTRA=film` adds")
def test_gymnasium_films_it(tmp_path: Path) -> None:
    """RecordVideo writes an episode."""
    made = RecordVideo(gymnasium.make(ID, render_mode="rgb_array", steps=4), str(tmp_path / "films"), disable_logger=True)
    made.reset(seed=0)
    for _ in range(4):
        made.step(np.zeros(24))
    made.close()
    assert [path.stat().st_size > 0 for path in tmp_path.glob("films/*.mp4")] == [True]


def test_what_cannot_be_drawn_is_refused() -> None:
    """Another mode, and a frame before the first reset."""
    with pytest.raises(ValueError, match="expected rgb_array or None, got 'human'"):
        AffordanceGrasp(render_mode="human")
    made = drawn()
    with pytest.raises(RuntimeError, match=r"call reset\(\) before"):
        made.render()
    made.close()


def test_what_is_given_by_default_is_what_stages_make() -> None:
    """The hand to the bit, the hammer by its mass and parts; it can be grasped by script, and only by its handle."""
    assert repr(default.hand()) == repr(shadow()) and default.hand().urdf == shadow().urdf
    built = object_build.run(default.TOOL, object_build.Params(atlas_px=64))
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


def test_a_task_survives_its_description() -> None:
    """What frames are drawn of is the task itself."""
    task = default.tool()
    again = from_grasp_task(grasp_task(task))
    assert again.hold == task.hold and np.array_equal(again.negative, task.negative) and np.array_equal(again.N_t, task.N_t)


def test_names_are_registered_once() -> None:
    """Again, and nothing happens; every entry point is there, and is that of the table, also where the install registered it."""
    before = {name: gymnasium.registry[name] for name in ENVIRONMENTS}
    assert {name: (one.entry_point, one.vector_entry_point) for name, one in before.items()} == ENVIRONMENTS
    register()
    assert {name: gymnasium.registry[name] for name in ENVIRONMENTS} == before
    for spec in before.values():
        assert callable(gymnasium.envs.registration.load_env_creator(spec.entry_point))
        assert callable(gymnasium.envs.registration.load_env_creator(spec.vector_entry_point))


def test_an_import_registers_the_same() -> None:
    """Where afford is on the path and not installed: -S leaves out what the install put into site-packages."""
    code = ("import sys; sys.path[:0] = sys.argv[1:]; import gymnasium; from afford.environments import ENVIRONMENTS as known\n"
            "assert not known.keys() & gymnasium.registry.keys()\n"
            "import afford.grasping.env.env, afford.grasping.imitation.imitate_env\n"
            "found = {name: gymnasium.registry[name] for name in known}\n"
            "assert {name: (one.entry_point, one.vector_entry_point) for name, one in found.items()} == known")
    path = [str(Path(__file__).resolve().parents[2]), *site.getsitepackages()]
    done = subprocess.run([sys.executable, "-S", "-c", code, *path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_reprs_are_short() -> None:
    """Shapes instead of arrays, for nouns, tasks and environments; a field of a noun is still there by name."""
    built = object_build.run(default.TOOL, object_build.Params(atlas_px=64))
    made = gymnasium.make(ID)
    for thing in (default.hand(), block(), built.mesh, built.parts, built, default.tool(), made, made.unwrapped):
        assert len(repr(thing)) < LONGEST and "\n" not in repr(thing), type(thing)
    assert "vertices=float32 (" in repr(built.mesh) and repr(built).startswith("PartedMesh(mesh=ObjectMesh('hammer')")
    assert repr(default.tool()) == "Task('hammer', hold='handle', negative=['head', 'face', 'claw'])"
    assert "hammer by its handle" in repr(made.unwrapped)
    assert Clip.__repr__ is block().__class__.__repr__
    made.close()
