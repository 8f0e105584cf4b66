"""Report tables: rows compared with published figures, tables of uses and of tasks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from afford.grasping.evaluate.recipes import ROWS as TRAININGS
from afford.grasping.evaluate.recipes import STUDENTS
from afford.grasping.evaluate.report import PUBLISHED, SAME, published_lines, same_pairs
from afford.grasping.evaluate.result_cells import ResultRow, group_cells, of_use, result_rows, task_lines, use_lines, use_of
from schemas.episodes import GraspEpisodes, GraspExam

FIGURES = ("success", "hls", "as_violation_pct")
OTHERS = ("held", "log_jerk", "as_safe_count", "negative_contact_end", "negative_contact_any")
"""further figures that a report requires"""


def episodes(policy: str, level: str, engine: str = "bullet", seed: int = 0, success: tuple[float, ...] = (1, 0)) -> GraspEpisodes:
    """Build episodes with HLS 4, and AS 20 for successes and 80 for failures."""
    values = np.array([[one, 4.0, 20.0 if one else 80.0, *np.zeros(len(OTHERS))] for one in success])
    name, tasks = f"{policy}-{seed}-{level}-{engine}", ("a/cut",) * len(success)
    return GraspEpisodes(name, policy, level, engine, seed, tasks, FIGURES + OTHERS, values, np.zeros((len(success), 4)), ())


def beside(found: list[ResultRow]) -> Iterator[list[str]]:
    """Yield the cells of each row of the comparison."""
    table = "\n".join(published_lines(found)).partition("## Beside the published")[2].partition("## Published")[0]
    shown = [line for line in table.splitlines() if line.startswith("| ") and "theirs" not in line]
    return ([word.strip() for word in line.split("|")[1:-1]] for line in shown)


def test_compared_rows_exist() -> None:
    """Names in SAME exist in our recipes and in the published tables."""
    published = {(one.table, one.row) for one in PUBLISHED}
    assert all(ours in {*TRAININGS, *STUDENTS} and (table, row) in published for ours, table, row in SAME)
    assert len(set(SAME)) == len(SAME)


def test_a_row_shows_both_figures() -> None:
    """Succ over seeds in percent, AS over successes, and the published figures."""
    found = result_rows(group_cells([episodes("student", "train"), episodes("student", "train", seed=1, success=(1, 1))]))
    assert list(beside(found)) == [
        ["vision", "AffordDex", "student", "train", "bullet", "87", "75.0", "8.3", "4.0", "10", "20.0", "2"]]


@pytest.mark.parametrize(("policy", "level", "expected"), [
    ("teacher", "train", ["AffordDex", "-10"]), ("teacher", "unseen_category", ["AffordDex"]), ("teacher", "unseen_size", []),
    ("no_negative", "train", ["HTI"]), ("no_negative", "unseen_object", []), ("neither", "train", ["none"]),
    ("lambda_half", "train", ["-5"]), ("lambda_double", "train", ["-20"]), ("on_script", "train", []), ("prior", "train", []),
    ("student_no_negative", "train", ["two of HTI, distillation, NAA", "another two of them"])])  # fmt: skip
def test_common_levels_are_compared(policy: str, level: str, expected: list[str]) -> None:
    """Rows of both engines are listed."""
    found = result_rows(group_cells([episodes(policy, level), episodes(policy, level, "mujoco")]))
    assert [theirs.row for _, theirs in same_pairs(found)] == [one for one in expected for _ in range(2)]
    assert all(theirs.level == row.level == level for row, theirs in same_pairs(found))


def test_unfinished_rows_are_not_compared() -> None:
    """The table is left out when it is empty; the published rows remain."""
    found = result_rows(group_cells([episodes("on_script", "train")], [GraspExam("teacher-0", "teacher", "train", "bullet")]))
    text = "\n".join(published_lines(found))
    assert "Beside" not in text and text.count("\n| ") == len(PUBLISHED) + 1


NAMES = ("knife_00/cut", "knife_01/cut", "knife_00/hand_over")


def task_episodes(seed: int, success: tuple[float, ...], policy: str = "teacher", engine: str = "bullet") -> GraspEpisodes:
    """Build six episodes, each task twice; half of the tips is near a negative part."""
    values = np.stack([np.array(success), np.full(6, 50.0)], 1)
    return GraspEpisodes(f"{policy}-{seed}-{engine}", policy, "train", engine, seed, NAMES * 2, ("success", "as_violation_pct"),
                         values, np.zeros((6, 4)), ())  # fmt: skip


RUNS = (task_episodes(0, (1, 1, 0, 1, 1, 0)), task_episodes(1, (1, 0, 1, 1, 0, 1)), task_episodes(0, (0,) * 6, "other"),
        task_episodes(0, (0,) * 6, engine="mujoco"))  # fmt: skip


def test_uses_partition_the_episodes() -> None:
    """An episode has one use, and its figures are unchanged."""
    parts = [of_use(RUNS[0], use) for use in ("cut", "hand_over")]
    assert [len(part.task) for part in parts] == [4, 2] and {use_of(task) for task in parts[1].task} == {"hand_over"}
    assert sum(part.figure("success").sum() for part in parts) == RUNS[0].figure("success").sum()
    assert all(len(part.depth_m) == len(part.values) == len(part.task) for part in parts)


def test_table_of_uses() -> None:
    """Four and two episodes of each of two seeds; the spread is over seeds; other policies and engines are left out."""
    rows = [line for line in use_lines(group_cells(RUNS)) if line.startswith("| train")]
    spread = 100 * np.std([1.0, 0.5], ddof=1), 100 * np.std([0.0, 1.0], ddof=1)
    assert rows == [f"| train | cut | 2 | 8 | 75.0 | {spread[0]:.1f} | 50.0 |",
                    f"| train | hand_over | 1 | 4 | 50.0 | {spread[1]:.1f} | 50.0 |"]  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1])
def test_table_of_tasks(seed: int) -> None:
    rows = [line for line in task_lines(RUNS[seed : seed + 1]) if line.startswith("| train")]
    assert [line.split(" | ")[1] for line in rows] == list(NAMES) and all(" | 2 | " in line for line in rows)


def test_uses_without_successes() -> None:
    """The column of AS over successes is empty."""
    assert use_lines(group_cells(RUNS[2:3]))[-1] == "| train | hand_over | 1 | 2 | 0.0 |  |  |"
