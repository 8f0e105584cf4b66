"""Rows of the tables of grasping: known, in an order in which what is stopped early has something of each."""

from __future__ import annotations

from dataclasses import replace

import pytest

from afford.grasp.recipes import POSITIVE, ROWS, STUDENT, TEACHER, planned
from stages import grasp_report, rl_grasp_refinement


def test_every_row_with_a_seed_comes_before_the_next_seed() -> None:
    assert planned((TEACHER, "neither"), 2) == ((TEACHER, 0), ("neither", 0), (TEACHER, 1), ("neither", 1))


def test_rows_change_parameters_that_there_are() -> None:
    for changes in ROWS.values():
        replace(rl_grasp_refinement.Params(), **changes)
    assert {*grasp_report.Params().rows, POSITIVE} == {*ROWS, STUDENT} and planned((*grasp_report.Params().rows, POSITIVE), 1)


def test_what_is_unknown_or_out_of_order_is_refused() -> None:
    for rows, seeds in ((("teacher", "magic"), 1), ((STUDENT, TEACHER), 1), ((TEACHER,), 0)):
        with pytest.raises(ValueError, match="grasp rows"):
            planned(rows, seeds)
