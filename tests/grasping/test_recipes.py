"""Training recipes: rows, their order, and their parameters on the map."""

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


def test_seeds_are_planned_one_after_another() -> None:
    assert planned_runs((TEACHER, "neither"), 2) == ((TEACHER, 0), ("neither", 0), (TEACHER, 1), ("neither", 1))


def test_rows_change_existing_parameters() -> None:
    for changes in ROWS.values():
        replace(rl_grasp_refinement.Params(), **changes)
    requested = (POSITIVE, "student_no_negative", *(name for name in ROWS if name.startswith("paper_")))
    every = (*grasp_report.Params().rows, *requested)
    assert sorted(every) == sorted((*ROWS, *STUDENTS)) and len(planned_runs(every, 1)) == len(every)


def test_reward_of_the_paper() -> None:
    """Four terms with the paper's weights, and its three lambda_n; all other rows except the transfers use our reward."""
    lambda_n = {"paper_none": 0, "paper_hti": 0, "paper_half": -5, "paper_reward": -10, "paper_size": -10, "paper_double": -20,
                "paper_light": -0.5}  # fmt: skip
    for name, weight in lambda_n.items():
        row = ROWS[name]
        assert reward_weights(row["reward"], scaled_negative_weights(row["reward"], row["lambda_n"])) == {
            "hand": -1, "goal": -1, "success": 1, "negative_tips": weight}
    assert {name for name, changes in ROWS.items() if "reward" in changes} == {
        *lambda_n, *(name for name in ROWS if name.startswith("transfer_"))}


def test_students_use_the_teacher_of_their_row() -> None:
    """The seed is that of the student."""
    rows = (TEACHER, NO_NEGATIVE, "student_no_negative", STUDENT)
    p = Settings()
    g = build("grasp-full", Origin("grasp-full"), p.with_stages(grasp_report=replace(p.grasping.grasp_report, rows=rows, seeds=2)))
    of = {node.name: g.nodes[dict(node.inputs)["teacher"]].name for node in g.stages() if "teacher" in dict(node.inputs)}
    assert of == {f"{student}_{seed}": f"{teacher}_{seed}.files" for student, teacher in STUDENTS.items() for seed in range(2)}
    without = p.with_stages(grasp_report=replace(p.grasping.grasp_report, rows=(NO_NEGATIVE,), naa=True))
    alone = build("grasp-full", Origin("grasp-full"), without)
    assert not [node for node in alone.stages() if node.name.startswith("teacher")]


def test_unknown_or_unordered_rows_are_rejected() -> None:
    for rows, seeds in ((("teacher", "magic"), 1), ((STUDENT, TEACHER), 1), ((TEACHER,), 0),
                        ((TEACHER, "student_no_negative", NO_NEGATIVE), 1), ((TEACHER, "student_no_negative"), 1)):
        with pytest.raises(ValueError, match="grasp rows"):
            planned_runs(rows, seeds)


def test_optional_rows_under_a_time_limit() -> None:
    """The first policy is recorded and the prior is an output; all other rows and their inputs are optional."""
    g = build("grasp-full", Origin("synthetic"), Settings())
    optional = g.optional([g.node_of(handle) for handle in g.targets["grasp-full"]])
    names = {node.name for node in g.stages() if node.id in optional}
    assert {"teacher_1", "student_0", "no_negative_0", "teacher_0_unseen_size_bullet", "teacher_naa_0_unseen_object_mujoco",
            "followed_train_bullet", "scorer_train", "teacher_0_two_tasks_bullet"} <= names
    assert not {"teacher_0", "teacher_0_train_bullet", "hand_imitation", "grasp_report", "grasp_record"} & names


@pytest.mark.parametrize(("target", "rows"), [("grasp", (TEACHER,)), ("grasp-full", (TEACHER, STUDENT))])
def test_the_first_teacher_and_student_are_outputs(target: str, rows: tuple[str, ...]) -> None:
    """Outputs are partial: a run ends without unfinished ones."""
    g = build(target, Origin(target), Settings())
    policies = next(node for node in map(g.node_of, g.targets[target]) if node.name == "policies")
    assert policies.partial and [g.nodes[i].name for _, i in policies.inputs] == [f"{row}_0.files" for row in rows]


def test_settings_reach_all_rows() -> None:
    """Clips, retargeting, first seeds, and factors of the weight of each row."""
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


def test_clips_approach_from_above_by_default() -> None:
    assert (Settings.grasping.motion_synthesise, Settings.grasping.hand_retarget) == (MOTION, FITTED)
    made = {node.name: node.params for node in build("grasp", Origin("grasp"), Settings()).stages()}
    assert (made["motion_synthesise"], made["hand_retarget"]) == (MOTION, FITTED)
