"""Blocks of pages that scripts write: what is not finished is marked."""

from __future__ import annotations

import pytest

from benchmarks import bench_grasp

FIGURES = {"succ": 0.5, "as_violation_pct": 4.0, "hls": 5.0, "negative_contact_end": 0.25}


@pytest.mark.parametrize(("seeds", "unfinished", "told"), [(3, 0, "3"), (2, 1, "2 of 3, not finished")])
def test_the_short_table_of_grasps_marks_what_is_not_finished(seeds: int, unfinished: int, told: str) -> None:
    """As the report does; a policy without figures has no row."""
    named = FIGURES | {"seeds": float(seeds), "unfinished": float(unfinished)}
    rows = bench_grasp.short({f"student.{name}.unseen_size": value for name, value in named.items()}).splitlines()[2:]
    assert rows == [f"| student | unseen size | 50.0 | 4.0 | 5.0 | 0.25 | {told} |"]
