"""Tables of uses and of tasks: episodes are shared out without loss, means are over seeds."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.evaluate.result_cells import group_cells, of_use, task_lines, use_lines, use_of
from schemas.episodes import GraspEpisodes

NAMES = ("knife_00/cut", "knife_01/cut", "knife_00/hand_over")


def episodes(seed: int, success: tuple[float, ...], policy: str = "teacher", engine: str = "bullet") -> GraspEpisodes:
    """Six episodes, each task twice, in turn; half of the tips of every one is near a forbidden part."""
    values = np.stack([np.array(success), np.full(6, 50.0)], 1)
    return GraspEpisodes(f"{policy}-{seed}-{engine}", policy, "train", engine, seed, NAMES * 2, ("success", "as_violation_pct"),
                         values, np.zeros((6, 4)), ())  # fmt: skip


RUNS = (episodes(0, (1, 1, 0, 1, 1, 0)), episodes(1, (1, 0, 1, 1, 0, 1)), episodes(0, (0,) * 6, "other"),
        episodes(0, (0,) * 6, engine="mujoco"))  # fmt: skip


def test_uses_part_the_episodes() -> None:
    """Every episode is of one use; nothing of it changes."""
    parts = [of_use(RUNS[0], use) for use in ("cut", "hand_over")]
    assert [len(part.task) for part in parts] == [4, 2] and {use_of(task) for task in parts[1].task} == {"hand_over"}
    assert sum(part.figure("success").sum() for part in parts) == RUNS[0].figure("success").sum()
    assert all(len(part.depth_m) == len(part.values) == len(part.task) for part in parts)


def test_a_use_is_told_over_seeds_of_the_first_policy() -> None:
    """Four and two episodes of each of two seeds; the spread is over seeds; other policies and engines are left out."""
    rows = [line for line in use_lines(group_cells(RUNS)) if line.startswith("| train")]
    spread = 100 * np.std([1.0, 0.5], ddof=1), 100 * np.std([0.0, 1.0], ddof=1)
    assert rows == [f"| train | cut | 2 | 8 | 75.0 | {spread[0]:.1f} | 50.0 |",
                    f"| train | hand_over | 1 | 4 | 50.0 | {spread[1]:.1f} | 50.0 |"]  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1])
def test_every_task_of_every_training_has_a_line(seed: int) -> None:
    rows = [line for line in task_lines(RUNS[seed : seed + 1]) if line.startswith("| train")]
    assert [line.split(" | ")[1] for line in rows] == list(NAMES) and all(" | 2 | " in line for line in rows)


def test_nobody_succeeds() -> None:
    """AS over successes has no value then."""
    assert use_lines(group_cells(RUNS[2:3]))[-1] == "| train | hand_over | 1 | 2 | 0.0 |  |  |"
