"""Tracking error of the imitation prior and of its baselines on held-out clips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.grasping.env.obs_blocks import obs_blocks
from afford.grasping.evaluate.comparisons import clip_lines, prior_ablation, tracking_metrics
from afford.grasping.rl import policy_files
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from schemas.episodes import ClipsFollowed, GraspEpisodes
from schemas.files import FileTree
from schemas.training import TrainingLog
from stages.grasping import imitation_evaluate
from tests.helpers.made_hands import shadow
from tests.helpers.made_priors import TOOLS, reference_set, targets
from tests.helpers.made_samples import Scratch
from tests.helpers.made_scenes import tool

FAST = imitation_evaluate.Params(engine="mujoco")


def idle(folder: Path, role: str = "prior") -> FileTree:
    """Write a policy that does nothing."""
    model = ActorCritic(PolicyConfig(sum(block.width for block in obs_blocks("small", "prior")), 24, (8,)))
    for parameter in list(model.actor.parameters())[-2:]:
        torch.nn.init.zeros_(parameter)
    posture = [0.0] * 24
    facts = {"role": role, "layout": "small", "base": "prior", "posture": posture, "steps": 40, "lift_m": 0.2}
    policy_files.write_policy(folder, model, facts)
    return tree("prior", folder)


def followed(folder: Path, clips: int | None = None, **params: object) -> ClipsFollowed:
    references = replace(reference_set(), references=reference_set().references[:clips])
    return imitation_evaluate.run(shadow(), tuple(map(tool, TOOLS)), references, idle(folder / "p"),
                                  replace(FAST, **params), Scratch(folder))  # type: ignore[arg-type]  # fields of Params


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> ClipsFollowed:
    return followed(tmp_path_factory.mktemp("followed"))


def of(found: ClipsFollowed, who: str, name: str) -> np.ndarray:
    rows = np.array([one == who for one in found.follower])
    column: np.ndarray = getattr(found, name)[rows]
    return column


def test_the_clip_baseline_is_near_and_the_still_baseline_is_far(found: ClipsFollowed) -> None:
    """An idle prior equals the still baseline to the bit."""
    count = len(targets())
    assert found.clip == tuple(one.name for one in reference_set().references) * 3 and len(found.clip) == 3 * count
    assert (of(found, "clip", "level_1_m") < 0.03).all() and of(found, "clip", "followed").all()
    assert (of(found, "still", "level_1_m") > 0.05).all() and not of(found, "still", "followed").any()
    for name in ("level_1_m", "level_2_m", "tips_m", "followed"):
        assert np.array_equal(of(found, "prior", name), of(found, "still", name))


def test_batch_size_does_not_matter(found: ClipsFollowed, tmp_path: Path) -> None:
    """One clip at a time: the error depends on the clip alone, wherever its object lies."""
    alone = followed(tmp_path, 2, at_once=1)
    assert np.array_equal(alone.level_1_m, followed(tmp_path / "again", 2, at_once=1).level_1_m)
    assert of(alone, "clip", "level_1_m") == pytest.approx(of(found, "clip", "level_1_m")[:2], abs=0.005)


def test_invalid_inputs_are_reported(tmp_path: Path) -> None:
    """Another policy than a prior, a clip of an unknown object, numbers out of range."""
    args = (shadow(), tuple(map(tool, TOOLS)), reference_set())
    with pytest.raises(ValueError, match="got another policy; use the output of hand_imitation"):
        imitation_evaluate.run(*args, idle(tmp_path / "t", "teacher"), FAST, Scratch(tmp_path))
    with pytest.raises(ValueError, match=f", got {tool(TOOLS[1]).name}; use"):
        imitation_evaluate.run(args[0], args[1][:1], args[2], idle(tmp_path / "p"), FAST, Scratch(tmp_path))
    with pytest.raises(ValueError, match="at_once and iterations of 1 or more"):
        followed(tmp_path, at_once=0)


def test_figures_are_named_by_follower_and_level(found: ClipsFollowed) -> None:
    metrics = tracking_metrics([found, replace(found, engine="bullet", level="unseen_object")])
    both = (of(found, "prior", "level_1_m") + of(found, "prior", "level_2_m")).mean() / 2
    assert metrics["mujoco.hti.tracking_mm"] == metrics["mujoco.hti.tracking_mm.train"] == pytest.approx(1000 * both)
    assert metrics["hti.clip.followed.unseen_object"] == 1 and metrics["hti.followed.unseen_object"] == 0
    assert "hti.tracking_mm" not in metrics and tracking_metrics([]) == {}
    text = "\n".join(clip_lines([found], {}))
    assert text.count("\n| ") == 4 and "With and without" not in text and clip_lines([], {}) == []


def played(policy: str, seed: int, success: list[float], jerk: list[float]) -> GraspEpisodes:
    values = np.array([success, jerk, jerk, jerk], float).T
    return GraspEpisodes(f"{policy}-train-bullet", policy, "train", "bullet", seed, ("a",) * len(success),
                         ("success", "log_jerk", "hls", "as_violation_pct"), values, np.full((len(success), 1), np.nan), ())


def test_ablation_of_the_prior_uses_common_seeds() -> None:
    """Seed 1 has no row without the prior and does not count; trainings of different lengths are rejected."""
    runs = [played("teacher", 0, [1, 1], [10, 12]), played("teacher", 1, [0, 0], [50, 50]), played("naa_only", 0, [1, 0], [14, 16])]
    logs = [TrainingLog("teacher-0", (), 200, 200), TrainingLog("naa_only-0", (), 200, 200)]
    metrics = prior_ablation(runs, logs)
    assert (metrics["hti.succ_with"], metrics["hti.succ_without"]) == (1, 0.5)
    assert (metrics["hti.jerk_with"], metrics["hti.jerk_without"]) == (11, 15)
    assert prior_ablation(runs[:2], logs) == {} and "| bullet | without | 50.0 | 15.0 |" in "\n".join(clip_lines([], metrics))
    with pytest.raises(ValueError, match="as many updates as teacher-0, got 100 and 200"):
        prior_ablation(runs, [logs[0], TrainingLog("naa_only-0", (), 100, 100)])


def test_the_scripted_baseline_is_compared_with_both() -> None:
    """The scripted baseline is also compared with the teacher alone; only common seeds count."""
    runs = [played("teacher", 0, [1, 1], [10, 12]), played("teacher", 1, [0, 0], [50, 50]), played("naa_only", 0, [1, 0], [14, 16]),
            played("naa_only", 1, [1, 1], [70, 70]), played("on_script", 0, [0, 1], [20, 22])]  # fmt: skip
    logs = [TrainingLog(f"{row}-{seed}", (), 200, 200) for row in ("teacher", "naa_only", "on_script") for seed in (0, 1)]
    metrics = prior_ablation(runs, logs)
    assert (metrics["hti.jerk_with"], metrics["hti.jerk_without"], metrics["hti.jerk_by_script"]) == (11, 15, 21)
    assert "| bullet | a script instead | 50.0 | 21.0 |" in "\n".join(clip_lines([], metrics))
    alone = prior_ablation([runs[0], runs[-1]], logs)
    assert alone["hti.succ_by_script"] == 0.5 and "hti.succ_without" not in alone
    assert "without |" not in "\n".join(clip_lines([], alone))
    with pytest.raises(ValueError, match="on_script-0: expected as many updates"):
        prior_ablation(runs, [*logs[:-2], TrainingLog("on_script-0", (), 100, 100)])
