"""Left and right in a sentence."""

from __future__ import annotations

import pytest

from afford.common.text import swap_sides


@pytest.mark.parametrize(("text", "swapped"), [
    ("Left hand, RIGHT hand", "Right hand, LEFT hand"),
    ("leftover bright copyright", "leftover bright copyright"),
    ("top-left", "top-right"),
])
def test_whole_words_are_swapped(text: str, swapped: str) -> None:
    """The case is kept, words that merely contain left or right are not touched."""
    assert swap_sides(text) == swapped
