"""Laws of the lexicon: it covers every thing that can be built, turns round where tasks turn round, and never guesses."""

from __future__ import annotations

import numpy as np
import pytest

from afford.surface.describe.lexicon import LEXICON, TASKS, ParsedTask, look_up, negative_parts, parse_task, role_changes, rule
from afford.surface.describe.looks import PARTS, part_phrase
from afford.surface.score.part_scorer import PartScorerConfig
from afford.synthetic.objects.library import BUILDERS
from schemas.surface import PartDescription


def built_parts(category: str) -> set[str]:
    return {solid.part for solid in BUILDERS[category](np.random.default_rng(0))}


def parts(found: PartDescription, role: str) -> set[str]:
    return {note.part for note in found.notes if note.role == role}


def test_the_table_covers_every_category_and_names_only_parts_that_exist() -> None:
    """Rows, tasks and builders speak of the same things; a part is not both; no row stands twice."""
    assert set(LEXICON) == set(TASKS) == set(BUILDERS)
    for category, rows in LEXICON.items():
        parts = built_parts(category)
        assert len({(row.verb, row.state) for row in rows}) == len(rows), category
        assert ("", "") in {(row.verb, row.state) for row in rows}, category
        for row in rows:
            assert {*row.negative, *row.positive} <= parts == set(PARTS[category].split()), (category, row)
            assert not {*row.negative} & {*row.positive} and (row.negative or row.positive) and row.reason


def test_the_scorer_reads_every_phrase_to_its_end() -> None:
    """How a part looks stands last, and is not to be cut off."""
    phrases = [part_phrase(kind, part) for kind, parts in PARTS.items() for part in parts.split()]
    assert max(len(text.split()) for text in phrases) <= PartScorerConfig().text_words


def test_at_least_twelve_pairs_of_tasks_turn_the_negative_part() -> None:
    """Of the evaluated tasks; in every category at least one."""
    turning = {category: {negative_parts(category, task) for task in tasks} for category, tasks in TASKS.items()}
    assert all(len(found) > 1 for found in turning.values()), turning
    assert sum(len(found) > 1 for found in turning.values()) >= 12


@pytest.mark.parametrize(("category", "task", "negative"), [
    ("knife", "cut bread", {"blade"}), ("knife", "hand over the knife", {"handle"}), ("knife", "wash the knife", {"blade"}),
    ("scissors", "give me the scissors", {"handle"}), ("mug", "drink hot tea", {"body", "rim"}),
    ("mug", "drink cold water", {"rim"}), ("kettle", "pour from the hot kettle", {"body", "spout", "opening", "lid"}),
    ("kettle", "Fill the cold kettle.", {"opening"}), ("pan", "carry the hot pan", {"body"}), ("pan", "carry the cold pan", set()),
    ("iron", "iron a shirt", {"plate"}), ("hammer", "drive a nail", {"face"}), ("drill", "drill a hole", {"chuck", "bit"}),
    ("screwdriver", "drive a screw", {"shaft", "tip"}), ("brush", "", {"bristles"}), ("fork", "juggle with it", {"tines"}),
])  # fmt: skip
def test_what_a_reader_expects(category: str, task: str, negative: set[str]) -> None:
    """Spot checks of the table, by the words of tasks."""
    assert negative_parts(category, task) == negative
    notes = look_up("x", category, task).notes
    assert {note.part for note in notes if note.role == "negative"} == negative


def test_handing_over_turns_sharp_things_round() -> None:
    """The giver holds what the user must not touch; the handle stays free."""
    for category in ("knife", "scissors", "saw", "chisel", "cleaver"):
        use, give = (look_up("x", category, task) for task in ("cut", "hand over"))
        assert parts(use, "negative") == parts(give, "positive") == {"blade"}
        assert parts(use, "positive") == parts(give, "negative") == {"handle"}
        assert all(n.task_changes for n in (*use.notes, *give.notes) if n.role != "neutral")


def test_notes_are_in_order_and_say_how_sure_they_are() -> None:
    """Negative first; a task that the table does not know is answered by what holds for any use, with less confidence."""
    for category, tasks in TASKS.items():
        for task in tasks:
            found = look_up("x", category, task)
            assert [n.part for n in found.notes] == PARTS[category].split()
            assert all(0 < n.confidence <= 1 and n.phrase.startswith("the ") for n in found.notes)
            assert all(bool(n.reason) == (n.role != "neutral") for n in found.notes)
            assert found.category == category and found.task == task and found.backend == "rules"
    assert look_up("x", "knife", "juggle").notes[0].confidence < look_up("x", "knife", "cut").notes[0].confidence


def test_task_changes_comes_out_of_the_table() -> None:
    """A trigger is negative only while the bit is changed or the drill handed over; the claw's row is turned by another."""
    assert role_changes("drill", "trigger", True) and role_changes("drill", "bit", True)
    for category, rows in LEXICON.items():
        for row in rows:
            for part in row.negative:
                assert role_changes(category, part, True) == any(part not in other.negative for other in rows)


@pytest.mark.parametrize("category", ["", "unknown", "sofa", "knives and forks", "blade"])
def test_unknown_is_unknown(category: str) -> None:
    """No notes, no guess; the truth of it is an error."""
    found = look_up("thing_1", category, "cut bread")
    assert (found.name, found.category, found.notes) == ("thing_1", "unknown", ())
    with pytest.raises(KeyError):
        negative_parts(category, "cut bread")


def test_names_of_things_are_read_as_people_write_them() -> None:
    """Capitals, spaces and hyphens; articles in phrases."""
    assert look_up("x", "Soldering iron", "").category == look_up("x", "soldering-iron", "").category == "soldering_iron"
    phrases = [n.phrase for n in look_up("x", "scissors", "").notes] + [n.phrase for n in look_up("x", "axe", "").notes]
    assert phrases[1].startswith("the blade of a pair of scissors, ") and phrases[-1].startswith("the blade of an axe, ")


@pytest.mark.parametrize(("text", "task"), [
    ("cut bread", ParsedTask("cut", "")), ("Hand over the knife", ParsedTask("hand over", "")),
    ("pour from the hot kettle", ParsedTask("pour", "hot")),
    ("pour the hot tea from the cold kettle", ParsedTask("pour", "cold")),
    ("pick up the mug", ParsedTask("carry", "")), ("", ParsedTask("", "")),
    ("cutlery drawer", ParsedTask("", "")), ("turn over the egg", ParsedTask("stir", "")), ("the hot plate", ParsedTask("", "hot")),
])  # fmt: skip
def test_tasks_are_read(text: str, task: ParsedTask) -> None:
    """The longest verb at the start, the last word of state."""
    assert parse_task(text) == task


def test_the_best_row_is_taken() -> None:
    """Verb and state before the verb alone, before the state alone, before any use."""
    assert rule("pan", "hand over the cold pan").negative == ("handle",)
    assert rule("pan", "wash the cold pan") == rule("pan", "wash the pan")
    assert rule("pan", "stir in the cold pan") == rule("pan", "the cold pan")
    assert rule("pan", "stir") == rule("pan", "")
