"""Prompt and parser of part descriptions: valid answers pass unchanged, all others give one sentence."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from afford.surface.describe.lexicon import look_up
from afford.surface.describe.looks import LOOKS, LOOKS_OF
from afford.surface.describe.prompt import LOOK_WORDS, json_objects, parse_answer, part_prompt
from schemas.surface import PartDescription

BLADE = {"part": "Cutting edge", "role": "negative", "looks": "a long flat thin plate", "reason": "It cuts.", "confidence": 0.9,
         "task_changes": True}  # fmt: skip
GRIP = BLADE | {"part": "handle", "role": "positive", "looks": "a thick bar", "reason": "Made for it.", "task_changes": False}


def said(*parts: object, category: object = "Bread knife", **more: object) -> str:
    return json.dumps({"category": category, "parts": parts, **more})


def parsed(text: str) -> PartDescription:
    return parse_answer(text, "thing_1", "cut bread", "vlm")


def test_valid_answers_pass_unchanged() -> None:
    """Check normalised names, phrases for the scorer, and that unknown fields are ignored."""
    found = parsed(said(BLADE | {"colour": "grey"}, GRIP, mood="good"))
    assert (found.name, found.category, found.task, found.backend) == ("thing_1", "bread_knife", "cut bread", "vlm")
    edge, grip = found.notes
    assert (edge.part, edge.role, edge.reason, edge.confidence) == ("cutting_edge", "negative", "It cuts.", 0.9)
    assert edge.phrase == "the cutting edge of a bread knife, a long flat thin plate"
    assert edge.task_changes and not grip.task_changes


@pytest.mark.parametrize("around", ["{}", "```json\n{}\n```", "Sure! {{here}} it is:\n{}\nAsk me {{more}}.",
                                    "<think>{{1}} {{}}</think>{}"])  # fmt: skip
def test_text_and_fences_are_ignored(around: str) -> None:
    """Check one JSON object in other text."""
    assert parsed(around.format(said(GRIP))) == parsed(said(GRIP))


@pytest.mark.parametrize("category", ["unknown", "Unknown", " unknown object "])
def test_unknown_objects_have_no_parts(category: str) -> None:
    """Check an answer that lists parts for an unknown object."""
    for text in (said(category=category), said(GRIP, category=category), json.dumps({"category": category})):
        assert parsed(text) == PartDescription("thing_1", "unknown", "cut bread", (), "vlm")


@pytest.mark.parametrize("text", ["", "I cannot help with that.", "{", "{" * 5000, '{"a":' * 5000, "[1, 2]", '{"parts": []}',
                                  said(GRIP)[:-2], said(GRIP) + said(BLADE), said(GRIP).replace("0.9", "NaN")])  # fmt: skip
def test_invalid_answers_are_refused(text: str) -> None:
    """Check that the error names object, task and backend, quotes the beginning, and gives advice."""
    with pytest.raises(ValueError, match="thing_1, cut bread: answer of backend 'vlm': expected one JSON object") as caught:
        parsed(text)
    assert repr(text[:200]) in str(caught.value) and "new_tokens" in str(caught.value) and len(str(caught.value)) < 450


@pytest.mark.parametrize(("field", "values"), [
    ("role", ["Negative", "bad", "", None, 1, ["negative"]]),
    ("confidence", [-0.1, 1.1, "0.9", None, True, 10**400]),
    ("task_changes", ["true", 0, None]),
    ("part", ["", " ", "--", 3, None, "a\ud800"]),
    ("looks", ["", None, "\u0007", 3]),
    ("reason", ["", None, {}]),
])  # fmt: skip
def test_invalid_fields_are_refused(field: str, values: list[Any]) -> None:
    """Check that no value is clipped, converted or dropped."""
    for value in values:
        with pytest.raises(ValueError, match=rf"parts\[1\], field '{field}': expected .*, got "):
            parsed(said(GRIP, BLADE | {field: value}))
    with pytest.raises(ValueError, match=rf"parts\[0\], field '{field}'"):
        parsed(said({key: value for key, value in BLADE.items() if key != field}))


@pytest.mark.parametrize("parts", [(), (GRIP, GRIP), (GRIP, GRIP | {"part": "HANDLE "}), ("blade",), (None,)])
def test_parts_are_distinct(parts: tuple[Any, ...]) -> None:
    """Check that a known object has parts, each once."""
    with pytest.raises(ValueError, match="parts"):
        parsed(said(*parts))
    with pytest.raises(ValueError, match="parts"):
        parsed(json.dumps({"category": "knife", "parts": {"handle": GRIP}}))


def test_neutral_parts_have_no_reason() -> None:
    """Check that the reason is empty, as in the lexicon."""
    assert parsed(said(GRIP | {"role": "neutral", "reason": "whatever"})).notes[0].reason == ""


def test_round_trip_of_the_lexicon() -> None:
    """Check that the lexicon, written as an answer, is parsed to itself."""
    table = look_up("thing_1", "knife", "cut bread")
    parts = [vars(note) | {"looks": note.phrase.partition(", ")[2]} for note in table.notes]
    assert parsed(said(*parts, category=table.category)).notes == table.notes


@given(st.text())
def test_any_text_is_parsed_or_refused(text: str) -> None:
    """Check that errors are ValueError with one printable line."""
    for around in (text, json.dumps({"category": text, "parts": [GRIP | {"part": text, "looks": text}]})):
        try:
            found = parsed(around)
        except ValueError as error:
            assert str(error).encode() and "\n" not in str(error)
        else:
            assert found.category == "unknown" or found.notes[0].phrase.isprintable()


@given(st.recursive(st.none() | st.booleans() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x), max_leaves=8))
def test_outermost_objects_are_found(value: Any) -> None:
    """Check the outermost JSON objects of a text."""
    assert list(json_objects(f"so {json.dumps({'v': value})} and")) == [{"v": value}]


def test_prompt_contains_category_task_and_sides() -> None:
    """Check that user text is quoted on one line."""
    full = part_prompt("soldering_iron", 'say "x"\nand y', ("front", "back"))
    assert '"soldering iron"' in full and r'"say \"x\"\nand y"' in full and "front, back" in full
    empty = part_prompt("", "", ("front",))
    assert LOOK_WORDS in full and LOOK_WORDS in empty
    assert "Somebody says" not in empty and "No task is given" in empty
    example = empty[empty.index('{"category": "unknown"') :]
    assert parsed(example).category == "unknown"


def test_offered_words_are_training_words() -> None:
    """Check that each is in the table of shapes, and that they suffice for nearly all of it."""
    learned, offered = words(*LOOKS.values(), *LOOKS_OF.values()), set(words(LOOK_WORDS))
    assert offered <= set(learned)
    assert sum(word in offered | {"a", "of", "with"} for word in learned) > 0.95 * len(learned)


def words(*texts: str) -> list[str]:
    """Split into words without the plural s."""
    return [word.rstrip("s") for word in re.findall(r"[a-z]+", " ".join(texts))]
