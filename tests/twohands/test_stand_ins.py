"""Words that a model was not trained with are read as others where one stands in, and named where none does."""

from __future__ import annotations

import pytest

from afford.twohands.model.model_folder import FILLERS, Vocabulary
from afford.twohands.model.stand_ins import ALIKE, SIDES, read_task, stand_ins

KNOWN = Vocabulary(("lift", "take", "cut", "pour"), ("mug", "jug", "board:chopping"),
                   ("board", "chopping", "cut", "from", "jug", "lift", "mug", "pour", "take"))  # fmt: skip


@pytest.mark.parametrize(("task", "text", "read_as", "unknown"), [
    ("lift mug", "lift mug", {}, ()),
    ("Lift the cup!", "lift the mug", {"cup": "mug"}, ()),
    ("pour tea from kettle", "pour from jug", {"kettle": "jug"}, ("tea",)),
    ("taking mugs", "take mug", {"taking": "take", "mugs": "mug"}, ()),
    ("cutting on board", "cut on board", {"cutting": "cut"}, ()),
    ("lift zorgblatt mug", "lift mug", {}, ("zorgblatt",)),
    ("lift zorgblatt", "lift zorgblatt", {}, ("zorgblatt",)),
    ("take cup with left hand", "take mug with left hand", {"cup": "mug"}, ()),
    ("", "", {}, ()),
])  # fmt: skip
def test_tasks_are_read_with_known_words(task: str, text: str, read_as: dict[str, str], unknown: tuple[str, ...]) -> None:
    """Tasks of known words do not change; a foreign word is left out when a thing is named."""
    found = read_task(task, KNOWN)
    assert (found.text, found.read_as, found.unknown) == (text, read_as, unknown)
    again = read_task(found.text, KNOWN)
    assert again.text == found.text and not again.read_as


def test_the_table_has_single_words_that_do_not_stand_in_for_themselves() -> None:
    for words, others in ALIKE.items():
        assert all(word.isalpha() for word in words) and not set(words) & set(others.split())
    assert not (stand_ins().keys() & (FILLERS | SIDES))
    assert all(len(set(words)) == len(words) for words in stand_ins().values())
