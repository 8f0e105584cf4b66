"""Random graphs and random events: the outputs of every run equal those of a clean build, and a second run does no work."""

from __future__ import annotations

import pytest

from tests.helpers.random_stories import Story

FEW, MANY = 8, 200


def live(seed: int) -> None:
    """Fail with the smallest story that still fails."""
    story = Story.of(seed)
    if fault := story.fault():
        small = story.smaller()
        pytest.fail(f"seed {seed}: {fault}\nsmaller: {small}\n{small.fault()}")


@pytest.mark.parametrize("seed", range(FEW))
def test_any_history_equals_a_clean_build(seed: int) -> None:
    """Edits, moves, damage, deletions, drops, kills, forced and simultaneous runs; no step by hand in between."""
    live(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(FEW, MANY))
def test_many_histories_equal_clean_builds(seed: int) -> None:
    """The same law for more seeds."""
    live(seed)
