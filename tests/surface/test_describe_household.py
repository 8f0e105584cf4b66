"""Second table of the lexicon: rows, names of meshes, shapes in the scorer's words, and categories of the first table."""

from __future__ import annotations

import re

import pytest

from afford.surface.describe.household import (
    PARTS_OF,
    ROWS,
    SAME_AS,
    SHAPES,
    SHAPES_OF,
    USES_OF,
    category_words,
    household_category,
    household_look_up,
    household_negative,
    household_rule,
    shape_of,
    uses_of,
)
from afford.surface.describe.lexicon import LEXICON, TASKS, look_up
from afford.surface.describe.looks import LOOKS, LOOKS_OF
from afford.surface.meshes.mend import category_of


def test_every_category_has_parts_rows_and_uses() -> None:
    """Rows name known parts, each in one role; there is a row for any use; the tables share no category."""
    assert ROWS.keys() == PARTS_OF.keys() == USES_OF.keys() and not ROWS.keys() & LEXICON.keys()
    for kind in ROWS:
        parts = set(PARTS_OF[kind].split())
        for verb, state, negative, positive, reason in ROWS[kind]:
            bad, good = set(negative.split()), set(positive.split())
            assert bad | good <= parts and good and not bad & good and reason, (kind, verb, state)
        assert household_rule(kind, "").verb == "" and len({household_rule(kind, use) for use in uses_of(kind)}) > 1
        assert all(shape_of(kind, part) for part in parts)
    assert {kind for kind, _ in SHAPES_OF} <= ROWS.keys() and all(household_category(kind) for kind in SAME_AS.values())


def test_shapes_use_words_that_the_scorer_learned() -> None:
    learned = set(re.findall(r"[a-z]+", " ".join((*LOOKS.values(), *LOOKS_OF.values()))))
    assert set(re.findall(r"[a-z]+", " ".join((*SHAPES.values(), *SHAPES_OF.values())))) <= learned


@pytest.mark.parametrize(("name", "kind"), [
    ("019_pitcher_base", "pitcher"), ("bleach_cleanser", "bottle"), ("tomato_soup_can", "can"), ("waterJug", "jug"),
    ("skillet", "pan"), ("cracker_box", "box"), ("windex_spray_bottle", "spray_bottle"), ("phillips_screwdriver", "screwdriver"),
    ("can_opener", ""), ("pitcher_lid", ""), ("box_cutter", ""), ("pizza_cutter", "pizza_cutter"), ("thing_1", ""),
])  # fmt: skip
def test_category_in_the_name_of_a_mesh(name: str, kind: str) -> None:
    """The last word decides; a can opener is no can."""
    assert household_category(category_of(name, category_words())) == kind


def test_roles_follow_the_task() -> None:
    """The cap is negative while a bottle is unscrewed, and only then; the first table is unchanged; others stay unknown."""
    roles = {note.part: note.role for note in household_look_up("x", "cleanser", "unscrew it").notes}
    assert roles == {"body": "positive", "neck": "neutral", "cap": "negative"}
    assert household_negative("bottle", "pour water") == {"neck", "cap"} and not household_negative("bottle", "")
    for kind, tasks in TASKS.items():
        assert uses_of(kind) == tasks and household_look_up("x", kind, tasks[0]) == look_up("x", kind, tasks[0])
    unknown = household_look_up("x", "gizmo", "use")
    assert unknown.category == "unknown" and not unknown.notes and uses_of("gizmo") == ()
