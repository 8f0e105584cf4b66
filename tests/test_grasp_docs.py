"""The page of the environments says what the code does."""

from __future__ import annotations

import pytest

from benchmarks import bench_grasp_env as page
from tests.made_hands import shadow


@pytest.mark.parametrize(("name", "block"), [
    ("action", lambda: page.actions(shadow())), ("observation", page.observations), ("reward", page.rewards),
    ("imitation", page.imitations), ("report", page.report), ("random", page.randomisation)])  # fmt: skip
def test_tables_are_those_of_the_code(name: str, block) -> None:  # type: ignore[no-untyped-def]  # a function without arguments
    """Written by benchmarks/bench_grasp_env.py, and not changed by hand since."""
    start, end = f"<!-- {name}: written by benchmarks/bench_grasp_env.py -->\n", f"<!-- end of {name} -->"
    text = page.PAGE.read_text()
    assert text.partition(start)[2].partition(end)[0] == block()
