"""Rows of the tables of grasping: known, in an order in which what is stopped early has something of each."""

from __future__ import annotations

from dataclasses import replace

import pytest

from afford.grasping.env.reward import reward_weights, scaled_negative_weights
from afford.grasping.evaluate.recipes import NO_NEGATIVE, POSITIVE, ROWS, STUDENT, STUDENTS, TEACHER, planned_runs
from commands.settings import settings
from maps.settings import Origin, Settings
from maps.settings.grasping import FITTED, MOTION
from pipeline import build
from stages.grasping import grasp_report, rl_grasp_refinement


def test_every_row_with_a_seed_comes_before_the_next_seed() -> None:
    assert planned_runs((TEACHER, "neither"), 2) == ((TEACHER, 0), ("neither", 0), (TEACHER, 1), ("neither", 1))


def test_rows_change_parameters_that_there_are() -> None:
    for changes in ROWS.values():
        replace(rl_grasp_refinement.Params(), **changes)
    asked_for = (POSITIVE, "student_no_negative", "paper_reward")
    every = (*grasp_report.Params().rows, *asked_for)
    assert sorted(every) == sorted((*ROWS, *STUDENTS)) and len(planned_runs(every, 1)) == len(every)


def test_the_papers_reward_is_the_papers() -> None:
    """Its four terms with its weights; all rows but it and the transfers learn from ours."""
    row = ROWS["paper_reward"]
    assert reward_weights(row["reward"], scaled_negative_weights(row["reward"], row["lambda_n"])) == {
        "hand": -1.0, "goal": -1.0, "success": 1.0, "negative_tips": -10.0}
    assert {name for name, changes in ROWS.items() if "reward" in changes} == {
        "paper_reward", *(name for name in ROWS if name.startswith("transfer_"))}


def test_students_learn_from_the_teacher_of_their_row() -> None:
    """And of their number."""
    rows = (TEACHER, NO_NEGATIVE, "student_no_negative", STUDENT)
    p = Settings()
    g = build("grasp-full", Origin("grasp-full"), p.with_stages(grasp_report=replace(p.grasping.grasp_report, rows=rows, seeds=2)))
    of = {node.name: g.nodes[dict(node.inputs)["teacher"]].name for node in g.stages() if "teacher" in dict(node.inputs)}
    assert of == {f"{student}_{seed}": f"{teacher}_{seed}.files" for student, teacher in STUDENTS.items() for seed in range(2)}
    without = p.with_stages(grasp_report=replace(p.grasping.grasp_report, rows=(NO_NEGATIVE,), naa=True))
    alone = build("grasp-full", Origin("grasp-full"), without)
    assert not [node for node in alone.stages() if node.name.startswith("teacher")]


def test_what_is_unknown_or_out_of_order_is_refused() -> None:
    for rows, seeds in ((("teacher", "magic"), 1), ((STUDENT, TEACHER), 1), ((TEACHER,), 0),
                        ((TEACHER, "student_no_negative", NO_NEGATIVE), 1), ((TEACHER, "student_no_negative"), 1)):
        with pytest.raises(ValueError, match="grasp rows"):
            planned_runs(rows, seeds)


def test_when_time_is_over_rows_are_left_but_what_every_report_shows_is_made() -> None:
    """The first policy is recorded, and the prior is an output; all others can wait, and so can what they are told."""
    g = build("grasp-full", Origin("synthetic"), Settings())
    spare = g.spare([g.node_of(handle) for handle in g.targets["grasp-full"]])
    names = {node.name for node in g.stages() if node.id in spare}
    assert {"teacher_1", "student_0", "no_negative_0", "teacher_0_unseen_size_bullet", "teacher_naa_0_unseen_object_mujoco",
            "followed_train_bullet", "scorer_train", "teacher_0_two_tasks_bullet"} <= names
    assert not {"teacher_0", "teacher_0_train_bullet", "hand_imitation", "grasp_report", "grasp_record"} & names


@pytest.mark.parametrize(("target", "rows"), [("grasp", (TEACHER,)), ("grasp-full", (TEACHER, STUDENT))])
def test_the_first_teacher_and_student_are_outputs(target: str, rows: tuple[str, ...]) -> None:
    """Those that are finished; the run ends without the others."""
    g = build(target, Origin(target), Settings())
    policies = next(node for node in map(g.node_of, g.targets[target]) if node.name == "policies")
    assert policies.partial and [g.nodes[i].name for _, i in policies.inputs] == [f"{row}_0.files" for row in rows]


def test_what_is_set_is_what_runs() -> None:
    """Clips, how the hand is fitted to them, the first seeds, and times the weight that each row has."""
    words = ("motion_synthesise.press=0.5", "hand_retarget.clip_steps=9", "rl_grasp_refinement.lambda_n=3",
             "rl_grasp_refinement.seed=10", "grasp_student.seed=20")  # fmt: skip
    params = {}
    for name, chosen in (("plain", Settings()), ("set", settings(words, None))):
        params[name] = {node.name: node.params for node in build("grasp-full", Origin("grasp-full"), chosen).stages()}
    plain, changed = params["plain"], params["set"]
    for of in ("", "train_held_out_"):
        assert changed[f"{of}motion_synthesise"] == replace(plain[f"{of}motion_synthesise"], press=0.5)
        assert changed[f"{of}hand_retarget"] == replace(plain[f"{of}hand_retarget"], clip_steps=9)
    assert changed["lambda_half_2"] == replace(plain["lambda_half_2"], name="lambda_half-12", seed=12, lambda_n=1.5)
    assert changed["no_negative_0"].lambda_n == 0 and plain["lambda_double_0"].lambda_n == 2
    assert changed["student_1"] == replace(plain["student_1"], name="student-21", seed=21)


def test_clips_come_from_above_unless_said() -> None:
    assert (Settings.grasping.motion_synthesise, Settings.grasping.hand_retarget) == (MOTION, FITTED)
    made = {node.name: node.params for node in build("grasp", Origin("grasp"), Settings()).stages()}
    assert (made["motion_synthesise"], made["hand_retarget"]) == (MOTION, FITTED)
