"""Tasks with predicted affordances: predictions change observations and rewards, never the evaluation."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import BaseOnly, EpisodeBatch, rollout
from afford.grasping.env.task import Task, from_grasp_task
from afford.grasping.evaluate.comparisons import agreement
from afford.grasping.evaluate.evaluate_policy import FIGURES
from afford.surface.negative.project import distance_to_points
from maps.settings import Origin, Settings
from pipeline import build
from schemas.episodes import GraspEpisodes
from schemas.grasp import GraspTask
from schemas.surface import NegativeAffordances, PositiveAffordance, PositiveAffordances
from stages.grasping import grasp_report, grasp_tasks, grasp_tasks_predicted, object_solids
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_objects import looked, projected
from tests.helpers.made_samples import Scratch
from tests.helpers.made_school import SCHOOL

PARAMS = grasp_tasks_predicted.Params()


@cache
def task() -> GraspTask:
    """A use of the screwdriver that the chain of negative affordances is tried on, in truth."""
    x = looked()
    return grasp_tasks.run(x.spec, object_solids.run(x.mesh, x.parts, object_solids.Params()), grasp_tasks.Params(within_m=1.0))[0]


@cache
def said() -> NegativeAffordances:
    """Negative affordances of a scorer that is never wrong."""
    return projected(looked())


def told(found: NegativeAffordances | None = None, **given: PositiveAffordances) -> GraspTask:
    return grasp_tasks_predicted.run((task(),), looked().mesh, PARAMS, found, **given)[0]


def nothing_said() -> NegativeAffordances:
    none = np.zeros((0, 3), np.float32)
    return replace(said(), tasks=tuple(replace(one, N_t=none, negative=np.zeros_like(one.negative)) for one in said().tasks))


def played(one: Task) -> tuple[EpisodeBatch, np.ndarray]:
    """An episode by script, on rewards of every kind, and what was observed at its end."""
    core = GraspWorlds(shadow(), [one], GraspEnvConfig(base="script", reward="dense"))
    found = rollout(core, BaseOnly(), [np.random.default_rng(0)])
    seen = core.observe()
    core.close()
    return found, seen


def test_mesh_and_body_share_a_frame() -> None:
    """Predicted points lie on the body's surface, whose points are 3 mm apart."""
    points = task().body.points
    assert distance_to_points(points, said().points).max() < 0.008 and distance_to_points(points, told(said()).N_t).max() < 0.008


def test_correct_prediction_equals_the_truth() -> None:
    one = told(said())
    assert one.told == one.negative == task().negative and min(agreement(one)) > 0.98
    assert not np.array_equal(one.N_t, task().N_t) and np.array_equal(from_grasp_task(one).N_true, from_grasp_task(task()).N_true)


def test_empty_prediction_gives_a_task_without_points() -> None:
    """The evaluation is unchanged; recall is 0, precision is NaN."""
    one = told(nothing_said())
    assert one.N_t.shape == (0, 3) and one.told == () and one.negative == task().negative
    assert agreement(one).recall == 0 and np.isnan(agreement(one).precision)
    assert len(from_grasp_task(one).N_true) == 100 and not from_grasp_task(one).told.any()


def test_evaluation_uses_the_truth() -> None:
    """Another N_t changes rewards and observations, but no figure of the same motion; another truth changes only the figures."""
    true = held_by_handle()
    handle = np.arange(len(true.negative)) == true.hold
    spots = true.body.points[true.body.point_part == true.hold].astype(np.float64)[:100]
    (plain, seen), (shown, seen_shown), (judged, seen_judged) = (
        played(one) for one in (true, replace(true, N_t=spots, told=handle), replace(true, N_true=spots, negative=handle)))
    assert np.array_equal(shown.q, plain.q) and np.array_equal(judged.q, plain.q)
    assert all(np.array_equal(shown.report[name], plain.report[name], equal_nan=True) for name in plain.report)
    assert shown.reward.sum() < plain.reward.sum() and not np.array_equal(seen_shown, seen)
    assert judged.report["as_violation_pct"][0] > plain.report["as_violation_pct"][0]
    assert judged.report["negative_contact_end"] == 1 and plain.report["negative_contact_end"] == 0
    assert judged.reward.tobytes() == plain.reward.tobytes() and seen_judged.tobytes() == seen.tobytes()


def test_measures_agree_when_the_prediction_is_the_truth() -> None:
    core = GraspWorlds(shadow(), [from_grasp_task(task()), held_by_handle()], GraspEnvConfig(base="script"))
    rngs = [np.random.default_rng(k) for k in range(2)]
    core.reset([0, 1], rngs)
    for action in np.random.default_rng(0).uniform(-1, 1, (30, 2, core.motors)):
        core.step(action, rngs)
        now = core.measures()
        assert np.array_equal(now.N_m, now.N_true_m) and np.array_equal(now.force_told, now.force_negative)
    core.close()


def test_positive_points_are_matched_by_use() -> None:
    """True positive points are safe and on the part to hold."""
    own = task()
    on = own.body.points[own.body.point_part == own.body.parts.index(own.hold)]
    assert distance_to_points(on, own.A_t).max() < 1e-6 and distance_to_points(own.N_t, own.A_t).min() > 0.02
    faces, at = len(looked().mesh.faces), np.array([[0.0, 0.01, 0.02]], np.float32)
    one = PositiveAffordance(own.use, *(np.zeros(shape, np.float32) for shape in (faces, (2, faces), faces, 4)), at)  # type: ignore[arg-type]
    found = told(positives=PositiveAffordances(own.body.name, (replace(one, task="another", A_t=at + 1), one)))
    assert np.array_equal(found.A_t, at.astype(float)) and np.array_equal(found.N_t, own.N_t)
    assert np.array_equal(from_grasp_task(found).A_t, found.A_t)


def test_predictions_of_other_objects_or_uses_are_refused() -> None:
    """A use without a prediction; a body of another size or of another object."""
    with pytest.raises(ValueError, match="expected a prediction for the use"):
        told(replace(said(), tasks=said().tasks[:0]))
    for body in (replace(task().body, size_m=1.15 * task().body.size_m), replace(task().body, name="other")):
        with pytest.raises(ValueError, match="expected tasks of the object that was predicted"):
            grasp_tasks_predicted.run((replace(task(), body=body),), looked().mesh, PARAMS, said())


def of_policy(name: str, as_pct: float) -> GraspEpisodes:
    values = np.array([[{"success": 1.0, "as_violation_pct": as_pct}.get(figure, 0.0) for figure in FIGURES]] * 2)
    return GraspEpisodes(name, name, "unseen_object", "mujoco", 0, ("a", "b"), FIGURES, values, np.zeros((2, 4)), ())


def test_report_of_predicted_tasks(tmp_path) -> None:  # type: ignore[no-untyped-def]  # a fixture
    """Affordance score next to that without penalties; the number of tasks without points; nothing without predictions."""
    rows = tuple(of_policy(name, value) for name, value in (("teacher", 5.0), ("no_negative", 15.0), ("teacher_naa", 6.0)))
    other = replace(of_policy("no_negative", 30.0), seed=1)
    tasks = ((told(said()),), (), (told(nothing_said()),))
    files = grasp_report.run((*rows, other), (), (), (), (), (), grasp_report.Params(), Scratch(tmp_path / "a"), tasks)
    found = json.loads(files.find("metrics.json").path.read_text())  # type: ignore[union-attr]  # it is there
    assert (found["naa.tasks"], found["naa.tasks_without_points"], found["naa.times_below.mujoco"]) == (2, 1, 2.5)
    assert found["naa.recall_2cm"] == pytest.approx(0.5, abs=0.01) and found["naa.precision_2cm"] > 0.98
    assert "mujoco.teacher_naa.as_violation_pct.unseen_object" in found
    text = files.find("report.md").path.read_text()  # type: ignore[union-attr]  # it is there
    assert "| mujoco | 5.0 | 6.0 | 15.0 | 2.5 |" in text and "1 of 2 tasks have no predicted point" in text
    drawn = (tasks[0], (replace(task(), A_t=np.zeros((0, 3))),))
    files = grasp_report.run(rows, (), (), (), (), (), grasp_report.Params(), Scratch(tmp_path / "c"), positives=drawn)
    found = json.loads(files.find("metrics.json").path.read_text())  # type: ignore[union-attr]  # it is there
    assert (found["positive.tasks_without_points"], found["positive.on_hold"]) == (1, 1) and "naa.tasks" not in found
    without = grasp_report.run(rows, (), (), (), (), (), grasp_report.Params(), Scratch(tmp_path / "b"))
    assert "as predicted" not in without.find("report.md").path.read_text()  # type: ignore[union-attr]  # it is there


def test_predictions_are_part_of_the_graph_on_request() -> None:
    """NAA by a switch; the two-hand model only for its row, which then trains on other tasks than the rest."""
    stages = {}
    for rows, naa in ((("teacher", "positive_truth"), True), (("teacher", "positive"), False)):
        asked = SCHOOL.with_stages(grasp_report=replace(SCHOOL.grasping.grasp_report, rows=rows, naa=naa))
        stages[naa] = {node.name: dict(node.inputs) for node in build("grasp-full", Origin("tiny"), asked).stages()}
    chain, model = {"scorer_train", "naa_tasks", "teacher_naa_0_unseen_object_mujoco"}, {"model_train", "positive_tasks"}
    assert chain <= set(stages[True]) and not model & set(stages[True]) and "predicted" in stages[True]["grasp_report"]
    assert model <= set(stages[False]) and not chain & set(stages[False]) and "predicted" not in stages[False]["grasp_report"]
    assert "positives" in stages[False]["grasp_report"] and "positives" not in stages[True]["grasp_report"]
    assert stages[False]["positive_0"]["tasks"] != stages[False]["teacher_0"]["tasks"]
    assert stages[True]["positive_truth_0"]["tasks"] == stages[True]["teacher_0"]["tasks"]
    plain = {node.name for node in build("grasp", Origin("tiny"), Settings()).stages()}
    assert not plain & (chain | model)
