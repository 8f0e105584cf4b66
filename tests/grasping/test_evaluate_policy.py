"""Evaluation of policies: initial states, figures of episodes, traces, and the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.env.carry import RAISED_M
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import BaseOnly, rollout
from afford.grasping.env.task import from_grasp_task
from afford.grasping.evaluate import result_cells
from afford.grasping.evaluate.evaluate_policy import FIGURES
from afford.grasping.evaluate.report import logs_by_row, markdown, metrics
from afford.grasping.evaluate.result_cells import group_cells
from schemas.episodes import GraspEpisodes, GraspExam
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import ReferenceSet, RetargetReport
from schemas.mesh import ObjectSpec
from schemas.spec import Context
from schemas.training import Curve, TrainingLog
from stages.grasping import grasp_evaluate, grasp_report, grasp_tasks
from tests.helpers.made_grasps import reference
from tests.helpers.made_hands import shadow
from tests.helpers.made_samples import Scratch
from tests.helpers.made_scenes import tool

NO_POLICY = FileTree("none", ())
FAST = grasp_evaluate.Params(policy="script", engine="mujoco", episodes=4, start="part", traces=2)


def tasks() -> tuple[GraspTask, ...]:
    specs = [ObjectSpec(kind, kind, 12, "plain", "train") for kind in ("screwdriver", "spatula")]
    return tuple(grasp_tasks.run(one, tool(one.category, 12), grasp_tasks.Params(within_m=1.0))[0] for one in specs)


def humans() -> ReferenceSet:
    kept = tuple(reference(shadow(), 60, seed) for seed in range(3))
    return ReferenceSet("humans", kept, RetargetReport("humans", (), 3, ()))


def evaluated(context: Context, **params: object) -> GraspEpisodes:
    return grasp_evaluate.run(shadow(), (tasks(),), NO_POLICY, humans(), replace(FAST, **params), context)  # type: ignore[arg-type]  # named


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> GraspEpisodes:
    return evaluated(Scratch(tmp_path_factory.mktemp("script")))


def test_the_script_holds_most_tools(script: GraspEpisodes) -> None:
    assert script.values.shape == (4, len(FIGURES)) and set(script.task) == {one.name for one in tasks()}
    assert script.figure("held").mean() >= 0.75 and (script.figure("success") >= script.figure("held")).all()
    assert ((script.figure("hls") >= 0) & (script.figure("hls") <= 10)).all()


def test_the_seed_fixes_initial_states(script: GraspEpisodes, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Fewer episodes are the first of more."""
    again, other = (evaluated(Scratch(tmp_path_factory.mktemp("again")), episodes=2, seed=seed) for seed in (FAST.seed, 1))
    assert np.array_equal(again.values, script.values[:2], equal_nan=True)
    assert np.array_equal(again.depth_m, script.depth_m[:2], equal_nan=True)
    assert not np.array_equal(other.values, script.values[:2], equal_nan=True)


def test_a_carry_changes_what_follows_the_lift(script: GraspEpisodes, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The base acts alone until an object is raised; then objects come nearer to their goals, and grasps are kept."""
    found = evaluated(Scratch(tmp_path_factory.mktemp("carried")), carry=True)
    for alone, carried in zip(script.traces, found.traces, strict=True):
        first = int(np.argmax(alone.body[:, 2] > alone.body[0, 2] + RAISED_M / 2))
        assert first > 5 and np.array_equal(alone.q[:first], carried.q[:first])
        assert not np.array_equal(alone.q, carried.q)
    assert found.figure("held").mean() >= script.figure("held").mean()
    assert found.figure("goal_m").mean() < script.figure("goal_m").mean()


def test_traces_agree_with_figures(script: GraspEpisodes) -> None:
    assert len(script.traces) == 2
    for trace in script.traces:
        k = script.task.index(trace.task)
        body = next(one.body for one in tasks() if one.name == trace.task)
        turn = trace.body[-1, 3:]
        assert np.linalg.norm(turn) == pytest.approx(1) and not trace.action[0].any() and len(trace.q) == 41
        assert trace.force[-1].sum() > 0 if script.figure("held")[k] else True
        assert script.depth_m[k][np.isfinite(script.depth_m[k])].max() == pytest.approx(trace.penetration_m.max())
        assert trace.goal[2] > body.com_m[2] + 0.15


def test_an_episode_that_ended_keeps_its_figures() -> None:
    one = tasks()[0]
    grasping = GraspWorlds(shadow(), [from_grasp_task(one)], GraspEnvConfig(base="script", steps=40))
    played = rollout(grasping, BaseOnly(), [np.random.default_rng(0)])
    assert played.ended.tolist() == [40] and played.q.shape[1] == 41
    assert played.report["held"][0] == grasping.report()["held"][0]
    grasping.close()


def test_missing_tasks_are_rejected(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(ValueError, match="grasp_evaluate: no tasks"):
        grasp_evaluate.run(shadow(), ((),), NO_POLICY, humans(), FAST, Scratch(tmp_path_factory.mktemp("none")))


def test_the_report_names_engines_levels_and_policies(script: GraspEpisodes, tmp_path_factory: pytest.TempPathFactory) -> None:
    strict = replace(script, engine="bullet", name="b", policy="teacher")
    found = metrics([strict, script])
    assert found["teacher.succ.train"] == found["teacher.succ"] == script.figure("success").mean()
    assert "mujoco.script.succ.train" in found and found["penetration_mm.p95"] == found["teacher.penetration_mm.p95"]
    two = metrics([strict, replace(script, policy="teacher", depth_m=2 * script.depth_m)])
    assert two["mujoco.penetration_mm.p95"] == two["mujoco.teacher.penetration_mm.p95"] > two["penetration_mm.p95"]
    assert "mujoco.penetration_mm.p95" not in found
    assert found["control_steps.bullet"] == found["control_steps.mujoco"] == script.depth_m.size == 4 * 40
    assert found["teacher.succ_low"] < found["teacher.succ"] <= 1 and len(group_cells([strict, script])) == 2
    text = markdown([strict, script])
    assert all(one.name in text for one in tasks()) and "UniDexGrasp++" in text
    here = Scratch(tmp_path_factory.mktemp("report"))
    files = grasp_report.run((strict, script), (), (), (), (), (), grasp_report.Params(), here)
    assert [file.name for file in files.files] == ["metrics.json", "report.md", "scores.json"]


def test_scores_are_listed_by_seed(script: GraspEpisodes) -> None:
    """The report has their mean; figures that one seed cannot have are left out."""
    both = [script, replace(script, seed=7, values=script.values * [0.0 if name == "success" else 1.0 for name in FIGURES])]
    found = result_cells.scores(both)
    (row,) = result_cells.result_rows(group_cells(both))
    assert list(found) == [f"script-{seed}-train-mujoco" for seed in (0, 7)] and row.seeds == 2
    assert [one["succ"] for one in found.values()] == [2 * row.figures["succ"], 0.0]
    assert all("succ_sd" not in one and one["penetration_mm.p95"] == row.figures["penetration_mm.p95"] for one in found.values())


def test_unfinished_seeds_are_marked(script: GraspEpisodes, tmp_path: Path) -> None:
    """A row with one of two seeds, and one with none; figures are of finished seeds."""
    planned = tuple(GraspExam(f"{policy}-{seed}", policy, script.level, script.engine)
                    for policy in (script.policy, "student") for seed in range(2))  # fmt: skip
    found = metrics([script], planned)
    assert (found[f"mujoco.{script.policy}.seeds"], found[f"mujoco.{script.policy}.unfinished"]) == (1, 1)
    assert (found["mujoco.student.seeds"], found["mujoco.student.unfinished"]) == (0, 2) and "mujoco.student.succ" not in found
    assert {name: value for name, value in found.items() if "student" not in name and "unfinished" not in name} == {
        name: value for name, value in metrics([script]).items() if "unfinished" not in name}
    lines = [line for line in markdown([script], (), planned).splitlines() if "not finished" in line]
    assert [line.split("|")[-2].strip() for line in lines] == ["1 of 2, not finished", "0 of 2, not finished"]
    files = grasp_report.run((script,), (), (), (), (), (), grasp_report.Params(), Scratch(tmp_path), planned=planned)
    assert "0 of 2, not finished" in files.find("report.md").path.read_text()  # type: ignore[union-attr]  # it is there


def test_figure_as_over_successes_and_all(script: GraspEpisodes) -> None:
    values = script.values.copy()
    for name, column in (("success", [1, 0, 1, 0]), ("as_violation_pct", [20, 80, 0, 60])):
        values[:, FIGURES.index(name)] = column
    found = metrics([replace(script, values=values, engine="bullet", policy="teacher")])
    assert found["teacher.as_violation_pct"] == 10 and found["teacher.as_violation_pct.all"] == 40


def test_group_names_and_last_figures_of_trainings(script: GraspEpisodes, tmp_path: Path) -> None:
    found = metrics([replace(script, policy="transfer_hti"), replace(script, policy="lambda_half", engine="bullet")])
    assert "mujoco.transfer.hti.succ.train" in found and "lambda.half.as_violation_pct" in found
    curve = Curve("train.as_violation_pct", np.arange(3), np.array([9.0, 5.0, 4.0]))
    logs = tuple(TrainingLog(name, (curve,), 3, 3) for name in ("prior", "teacher-0", "teacher-1"))
    files = grasp_report.run((script,), logs, (), (), (), (), grasp_report.Params(), Scratch(tmp_path))
    figures = json.loads(files.find("metrics.json").path.read_text())  # type: ignore[union-attr]  # it is there
    assert figures["hti.train.as_violation_pct"] == figures["training.teacher-1.train.as_violation_pct"] == 4.0
    assert files.find("curves.png") and set(logs_by_row(logs)) == {"teacher"}


def test_an_empty_report_is_rejected(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(ValueError, match="no episodes to report"):
        grasp_report.run((), (), (), (), (), (), grasp_report.Params(), Scratch(tmp_path_factory.mktemp("empty")))
