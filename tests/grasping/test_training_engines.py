"""Engine and device of the trainings: what they add to the key, and trainings in mujoco-warp (skipped without the extra `gpu`)."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from commands.backends import ROOT
from commands.errors import UsageError
from commands.settings import check_value
from runner.modules import Modules
from runner.resources import resources_of
from runner.selection import declarations, select_of
from stages.grasping import grasp_student, hand_imitation, rl_grasp_refinement
from tests.grasping.test_rl_grasp_refinement import content, trained

STAGES = (rl_grasp_refinement, hand_imitation, grasp_student)
there = pytest.mark.skipif(not (importlib.util.find_spec("mujoco_warp") and importlib.util.find_spec("warp")),
                           reason="the extra gpu is not installed")  # fmt: skip


@pytest.mark.parametrize("stage", STAGES)
def test_engine_and_device_decide_what_is_in_the_key(stage: ModuleType) -> None:
    """Versions of warp with engine=warp only; the kind of machine with warp or a GPU; one GPU for a device cuda."""
    modules, default = Modules(ROOT), stage.Params()
    assert (default.engine, default.device) == ("mujoco", "cpu")
    for engine, device in (("mujoco", "cpu"), ("bullet", "cuda"), ("warp", "cpu"), ("warp", "cuda:1")):
        params = replace(default, engine=engine, device=device)
        found = declarations(modules, stage.__name__, select_of(params))
        assert ({"mujoco-warp", "warp-lang"} <= set(found["LIBRARIES"])) == (engine == "warp")
        assert found["MACHINE"] == (True if engine == "warp" else ["device"])
        assert resources_of(found, params).gpus == (device != "cpu")


@pytest.mark.parametrize("stage", STAGES)
def test_wrong_engines_and_devices_are_refused(stage: ModuleType) -> None:
    """The command line lists the engines and the forms of a device."""
    name = stage.__name__.rpartition(".")[2]
    check_value(name, "engine", "warp", stage.Params())
    with pytest.raises(UsageError, match="engine"):
        check_value(name, "engine", "isaac", stage.Params())
    with pytest.raises(UsageError, match="expected cpu, cuda or cuda:N"):
        check_value(name, "device", "tpu", stage.Params())


def test_training_rejects_an_unknown_engine(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected an engine of mujoco, bullet, warp, got 'isaac'"):
        trained(tmp_path / "run", engine="isaac")


def test_training_in_bullet(tmp_path: Path) -> None:
    """The training ends in other weights than a training in MuJoCo, of the same form."""
    one, two = trained(tmp_path / "a", engine="bullet", updates=1), trained(tmp_path / "b", updates=1)
    assert content(one).keys() == content(two).keys()
    assert content(one)["policy.safetensors"] != content(two)["policy.safetensors"]


@there
@pytest.mark.slow
def test_training_in_warp_is_repeatable(tmp_path: Path) -> None:
    """Two trainings have the same bytes, no world diverges, and rewards are near those of MuJoCo."""
    params = {"engine": "warp", "updates": 2, "worlds": 4, "steps": 8}
    one, two = trained(tmp_path / "a", **params), trained(tmp_path / "b", **params)
    assert content(one) == content(two)
    other = trained(tmp_path / "c", **{**params, "engine": "mujoco"})
    rewards = [{c.name: c.value for c in made.log.curves if "reward" in c.name} for made in (one, other)]
    assert "train.diverged" not in {curve.name for curve in one.log.curves}
    assert rewards[0].keys() == rewards[1].keys()
    for name, value in rewards[0].items():
        np.testing.assert_allclose(value[0], rewards[1][name][0], atol=0.02)
