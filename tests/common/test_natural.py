"""Names in the order of their numbers: for zero-padded names that of plain text, for others that of the numbers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from afford.common.text import natural_key

WORDS = st.text(st.sampled_from("aZ_-. /:é"), max_size=3)


@given(st.lists(st.tuples(WORDS, st.integers(0, 9999), WORDS), max_size=8))
def test_padded_names_keep_the_order_of_text(parts: list[tuple[str, int, str]]) -> None:
    """Whatever stands around the number, before or after digits in the code."""
    names = [f"{before}{number:04d}{after}" for before, number, after in parts] + [f"{before}{after}" for before, _, after in parts]
    assert sorted(names, key=natural_key) == sorted(names)


@given(st.lists(st.integers(0, 10**30), unique=True), WORDS)
def test_numbers_are_sorted_by_value(numbers: list[int], before: str) -> None:
    """Numbers of any length keep their order."""
    assert sorted((f"{before}{n}.png" for n in numbers), key=natural_key) == [f"{before}{n}.png" for n in sorted(numbers)]


@given(st.permutations(["1.png", "01.png", "001.png", "2.png", "1_a.png"]))
def test_the_order_does_not_depend_on_that_of_the_folder(names: list[str]) -> None:
    """One number written in several ways, too."""
    assert sorted(names, key=natural_key) == ["001.png", "01.png", "1.png", "1_a.png", "2.png"]
