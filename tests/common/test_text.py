"""Natural order of names, and exchange of left and right."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from afford.common.text import natural_key, swap_sides

WORDS = st.text(st.sampled_from("aZ_-. /:é"), max_size=3)


@given(st.lists(st.tuples(WORDS, st.integers(0, 9999), WORDS), max_size=8))
def test_padded_names_keep_the_order_of_text(parts: list[tuple[str, int, str]]) -> None:
    """Check any text around the number, also digits."""
    names = [f"{before}{number:04d}{after}" for before, number, after in parts] + [f"{before}{after}" for before, _, after in parts]
    assert sorted(names, key=natural_key) == sorted(names)


@given(st.lists(st.integers(0, 10**30), unique=True), WORDS)
def test_numbers_are_in_their_order(numbers: list[int], before: str) -> None:
    """Check numbers of any length."""
    assert sorted((f"{before}{n}.png" for n in numbers), key=natural_key) == [f"{before}{n}.png" for n in sorted(numbers)]


@given(st.permutations(["1.png", "01.png", "001.png", "2.png", "1_a.png"]))
def test_order_is_independent_of_the_input(names: list[str]) -> None:
    """Check numbers that are written in several ways."""
    assert sorted(names, key=natural_key) == ["001.png", "01.png", "1.png", "1_a.png", "2.png"]


@pytest.mark.parametrize(("text", "swapped"), [
    ("Left hand, RIGHT hand", "Right hand, LEFT hand"),
    ("leftover bright copyright", "leftover bright copyright"),
    ("top-left", "top-right"),
])
def test_whole_words_are_swapped(text: str, swapped: str) -> None:
    """Check that the case is kept, and words that contain left or right are unchanged."""
    assert swap_sides(text) == swapped
