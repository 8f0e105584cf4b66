"""Lexicon: coverage of all buildable categories, dependence on the task, and no guesses."""

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


def test_lexicon_covers_every_category_with_existing_parts() -> None:
    """Check that rows, tasks and builders agree, roles are disjoint, and no row is repeated."""
    assert set(LEXICON) == set(TASKS) == set(BUILDERS)
    for category, rows in LEXICON.items():
        parts = built_parts(category)
        assert len({(row.verb, row.state) for row in rows}) == len(rows), category
        assert ("", "") in {(row.verb, row.state) for row in rows}, category
        for row in rows:
            assert {*row.negative, *row.positive} <= parts == set(PARTS[category].split()), (category, row)
            assert not {*row.negative} & {*row.positive} and (row.negative or row.positive) and row.reason


def test_phrases_fit_the_text_window() -> None:
    """Check that the shape, which comes last, is not truncated."""
    phrases = [part_phrase(kind, part) for kind, parts in PARTS.items() for part in parts.split()]
    assert max(len(text.split()) for text in phrases) <= PartScorerConfig().text_words


def test_tasks_change_the_negative_part() -> None:
    """Check at least one pair of tasks in every category, and twelve in all."""
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
def test_known_rows(category: str, task: str, negative: set[str]) -> None:
    """Check some rows by the words of tasks."""
    assert negative_parts(category, task) == negative
    notes = look_up("x", category, task).notes
    assert {note.part for note in notes if note.role == "negative"} == negative


def test_handing_over_swaps_roles_of_sharp_tools() -> None:
    """Check that the handle stays free for the receiver."""
    for category in ("knife", "scissors", "saw", "chisel", "cleaver"):
        use, give = (look_up("x", category, task) for task in ("cut", "hand over"))
        assert parts(use, "negative") == parts(give, "positive") == {"blade"}
        assert parts(use, "positive") == parts(give, "negative") == {"handle"}
        assert all(n.task_changes for n in (*use.notes, *give.notes) if n.role != "neutral")


def test_order_and_confidence_of_notes() -> None:
    """Check that negative parts come first, and that unknown tasks have a lower confidence."""
    for category, tasks in TASKS.items():
        for task in tasks:
            found = look_up("x", category, task)
            assert [n.part for n in found.notes] == PARTS[category].split()
            assert all(0 < n.confidence <= 1 and n.phrase.startswith("the ") for n in found.notes)
            assert all(bool(n.reason) == (n.role != "neutral") for n in found.notes)
            assert found.category == category and found.task == task and found.backend == "rules"
    assert look_up("x", "knife", "juggle").notes[0].confidence < look_up("x", "knife", "cut").notes[0].confidence


def test_task_changes_follows_the_lexicon() -> None:
    """Check parts whose role depends on the task."""
    assert role_changes("drill", "trigger", True) and role_changes("drill", "bit", True)
    for category, rows in LEXICON.items():
        for row in rows:
            for part in row.negative:
                assert role_changes(category, part, True) == any(part not in other.negative for other in rows)


@pytest.mark.parametrize("category", ["", "unknown", "sofa", "knives and forks", "blade"])
def test_unknown_categories(category: str) -> None:
    """Check for no notes, and an error of the ground truth."""
    found = look_up("thing_1", category, "cut bread")
    assert (found.name, found.category, found.notes) == ("thing_1", "unknown", ())
    with pytest.raises(KeyError):
        negative_parts(category, "cut bread")


def test_spelling_of_categories() -> None:
    """Check capitals, spaces and hyphens, and articles in phrases."""
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
def test_parsing_of_tasks(text: str, task: ParsedTask) -> None:
    """Check the longest verb at the start, and the last state word."""
    assert parse_task(text) == task


def test_most_specific_row_is_selected() -> None:
    """Check verb and state before the verb alone, before the state alone, before any use."""
    assert rule("pan", "hand over the cold pan").negative == ("handle",)
    assert rule("pan", "wash the cold pan") == rule("pan", "wash the pan")
    assert rule("pan", "stir in the cold pan") == rule("pan", "the cold pan")
    assert rule("pan", "stir") == rule("pan", "")
