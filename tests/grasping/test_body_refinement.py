"""Refinement of a teacher on bodies: worlds by place and family, starts off their places, the frozen prior, exact resumption."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.policies.load_policy import load_policy, prior_columns
from afford.grasping.policies.refine_on_bodies import LooselyPlacedWorlds, worlds_of
from afford.grasping.rl.policy_files import write_policy
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from afford.grasping.sim.scene import Physics
from schemas.files import FileTree
from schemas.training import Trained
from stages.grasping import body_evaluate, body_refinement
from tests.grasping.test_adapt_teacher import Run, content
from tests.grasping.test_bodies import stick, tasks_of
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import teacher

TASKS = tuple(tasks_of(stick()).tasks)
TINY = body_refinement.Params(updates=22, epochs=1, iterations=10, family_worlds=0)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    """Files of an untrained teacher, whose episodes are short."""
    return teacher(tmp_path_factory.mktemp("policy"), base="none", steps=3)


def refined(scratch: Path, policy: FileTree, dies_at: int = 0, **params: object) -> Trained:
    context = Run(scratch, dies_at)
    return body_refinement.run(shadow(), (TASKS,), policy, replace(TINY, **params), context)  # type: ignore[arg-type]


def test_a_killed_refinement_resumes_to_the_same_files(tmp_path: Path, policy: FileTree) -> None:
    """Same seed, same bytes, also after a kill behind a checkpoint; another seed gives others; the teacher itself has changed."""
    once = refined(tmp_path / "once", policy)
    with pytest.raises(KeyboardInterrupt):
        refined(tmp_path / "killed", policy, dies_at=21)
    assert (tmp_path / "killed" / "checkpoint.safetensors").exists()
    weights = {name: digest for name, digest in content(once).items() if name.startswith("policy")}
    again = content(refined(tmp_path / "killed", policy))
    assert weights == {name: again[name] for name in weights} and once.log.steps == 22
    assert content(refined(tmp_path / "other", policy, seed=1))["policy.safetensors"] != weights["policy.safetensors"]
    before = load_policy(policy, {})
    after = load_policy(once.files, {})
    assert before.teacher is not None and after.teacher is not None
    assert not np.array_equal(*(one.actor[0].weight.detach().numpy() for one in (before.teacher, after.teacher)))
    assert after.facts["steps"] == 3 and after.facts["base"] == "none"


def test_the_prior_stays_as_it_was(tmp_path: Path) -> None:
    """The residual learns; the file of the frozen prior has the same bytes."""
    folder = tmp_path / "policy"
    teacher(folder, base="prior", posture=(0.0,) * 24, steps=3)
    torch.manual_seed(1)
    prior = ActorCritic(PolicyConfig(len(prior_columns("small", "teacher")), 24, (8,)))
    write_policy(folder / "prior", prior, {"role": "prior", "layout": "small"})
    files = tree("teacher", folder)
    before, after = ({file.name: file.path.read_bytes() for file in one.files}
                     for one in (files, refined(tmp_path / "run", files, updates=2).files))  # fmt: skip
    assert after["prior/policy.safetensors"] == before["prior/policy.safetensors"]
    assert after["policy.safetensors"] != before["policy.safetensors"]


def test_a_refined_policy_is_evaluated_as_the_teacher_is(tmp_path: Path, policy: FileTree) -> None:
    """Its files are those of a teacher."""
    files = refined(tmp_path / "run", policy, updates=1).files
    params = body_evaluate.Params(engine="mujoco", episodes=1, iterations=20)
    found = body_evaluate.run(shadow(), TASKS, files, params, Run(tmp_path / "seen"))  # type: ignore[arg-type]
    assert set(found.task) == {one.name for one in TASKS}


def test_worlds_differ_in_body_pose_place_or_n_t() -> None:
    """Uses of one place are one world, unless only one of them has N_t; tasks of a rare family have several worlds."""
    first = next(one for one in TASKS if len(one.N_t))
    cut, wash, upright = (replace(first, name=f"stick/{name}") for name in ("flat/cut", "flat/wash", "upright/cut"))
    free = replace(cut, name="stick/flat/carry", N_t=np.zeros((0, 3)), negative=())
    assert [one.name for one in worlds_of([cut, wash, upright, free], 0)] == [cut.name, upright.name, free.name]
    assert [one.name for one in worlds_of([cut, wash], 5)] == [cut.name] * 5


def test_every_second_hand_begins_off_its_place(policy: FileTree) -> None:
    """Places and yaws have the standard deviations asked for; the other hands begin exactly over theirs."""
    config = load_policy(policy, {}).config("mujoco", Physics(iterations=10, rate_hz=240), "flat", 0.0)
    exact, loose = (kind(shadow(), [TASKS[0]] * 2, config) for kind in (PlacedWorlds, LooselyPlacedWorlds))
    loose.off_m, loose.off_rad = 0.01, 0.2
    try:
        off = []
        for seed in range(40):
            for worlds in (exact, loose):
                worlds.reset([0, 1], [np.random.default_rng([seed, k]) for k in range(2)])
            (first, second), (loose_first, loose_second) = exact.aims, loose.aims
            np.testing.assert_array_equal(second.place, loose_second.place)
            off.append([*(loose_first.place - first.place), loose_first.yaw - first.yaw])
        spread = np.std(off, axis=0)
        assert spread[2] == 0 and np.all((spread[[0, 1, 3]] > (0.006, 0.006, 0.12)) & (spread[[0, 1, 3]] < (0.014, 0.014, 0.28)))
    finally:
        exact.close()
        loose.close()


def test_refinement_refuses_other_inputs(tmp_path: Path, policy: FileTree) -> None:
    """No task, numbers out of range, or a policy over the script: one sentence."""
    for tasks, params, word in (((), TINY, "0 tasks"), ((TASKS,), replace(TINY, updates=0), "updates of 1"),
                                ((TASKS,), replace(TINY, off_m=-1.0), "off_m")):  # fmt: skip
        with pytest.raises(ValueError, match=word):
            body_refinement.run(shadow(), tasks, policy, params, Run(tmp_path / "none"))  # type: ignore[arg-type]
    scripted = teacher(tmp_path / "scripted", base="script", steps=3)
    with pytest.raises(ValueError, match="another policy"):
        refined(tmp_path / "none", scripted)
