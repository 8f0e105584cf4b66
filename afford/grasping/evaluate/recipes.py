"""Training recipes: the rows of the result tables, as changes of the teacher's parameters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

TEACHER, NO_NEGATIVE, STUDENT = "teacher", "no_negative", "student"
STUDENTS = {STUDENT: TEACHER, "student_no_negative": NO_NEGATIVE}
"""row of a student -> row of its teacher"""
POSITIVE, POSITIVE_TRUTH = "positive", "positive_truth"
CARRIED = "teacher_carried"
"""evaluation of every teacher with the carry, and with fingers that let go of N_t (env/carried_worlds.py)"""
NAA = 1.0
"""factor of the negative terms of a set of rewards, for every row with NAA: as the set defines them (docs/decisions/014)"""
SCRIPT: dict[str, Any] = {"base": "script", "std": 0.1, "std_along": 0.35, "steps": 44}
ALONE: dict[str, Any] = {"base": "none", "std": 0.5, "std_along": 0.5}
"""without a base that holds objects, more exploration noise costs nothing"""
ROWS: dict[str, dict[str, Any]] = {
    TEACHER: {"lambda_n": NAA},
    NO_NEGATIVE: {"lambda_n": 0.0},
    "naa_only": {**ALONE, "lambda_n": NAA},
    "neither": {**ALONE, "lambda_n": 0.0},
    "on_script": {**SCRIPT, "lambda_n": NAA},
    "on_script_no_negative": {**SCRIPT, "lambda_n": 0.0},
    "lambda_half": {"lambda_n": NAA / 2},
    "lambda_double": {"lambda_n": NAA * 2},
    "paper_none": {**ALONE, "reward": "afforddex", "lambda_n": 0.0},
    "paper_hti": {"reward": "afforddex", "lambda_n": 0.0},
    "paper_reward": {"reward": "afforddex", "lambda_n": NAA},
    "paper_half": {"reward": "afforddex", "lambda_n": NAA / 2},
    "paper_double": {"reward": "afforddex", "lambda_n": NAA * 2},
    "paper_light": {"reward": "afforddex", "lambda_n": NAA / 20},
    "paper_size": {"reward": "afforddex", "lambda_n": NAA, "size": "paper"},
    POSITIVE_TRUTH: {"lambda_n": NAA, "positive": -1.0},
    POSITIVE: {"lambda_n": NAA, "positive": -1.0},
    "transfer_none": {**ALONE, "reward": "unidexgrasp++", "lambda_n": 0.0},
    "transfer_hti": {"reward": "unidexgrasp++", "lambda_n": 0.0},
    "transfer_naa": {**ALONE, "reward": "unidexgrasp++", "lambda_n": NAA},
    "transfer_both": {"reward": "unidexgrasp++", "lambda_n": NAA},
}
"""teacher: HTI and NAA, the first two stages of AffordDex; no_negative: HTI alone; naa_only: without the prior; neither: PPO from
scratch; on_script*: a scripted grasp instead of the prior; lambda_*: other weights of the negative terms; paper_*: the paper's
four terms instead of `dense` (paper_reward: all, with lambda_n of -10; paper_half, paper_double and paper_light: -5, -20, -0.5;
paper_hti and paper_none: without the negative term, and without the prior as well; paper_size: with its networks); positive*:
fingertips are attracted to A_t, half as much as to the surface (true, or predicted by the two-hand model); transfer_*: both added
to the rewards of UniDexGrasp++"""


def planned_runs(rows: Iterable[str], seeds: int) -> tuple[tuple[str, int], ...]:
    """List (row, seed): every row with seed 0, then with seed 1, and so on.

    ValueError for an unknown row, a student before its teacher, or no seed.
    """
    wanted = tuple(rows)
    unknown = sorted(set(wanted) - {*ROWS, *STUDENTS})
    early = [one for one in wanted if one in STUDENTS and STUDENTS[one] not in wanted[: wanted.index(one)]]
    if unknown or early or seeds < 1:
        order = " and ".join(f"{student} after {teacher}" for student, teacher in STUDENTS.items())
        raise ValueError(f"grasp rows: expected some of {', '.join((*ROWS, *STUDENTS))}, {order}, and at least one seed, got "
                         f"{', '.join(unknown) or ', '.join(wanted)} and {seeds}")
    return tuple((row, seed) for seed in range(seeds) for row in wanted)
