"""Laws of the parser: what was asked for comes through whole, anything else is one sentence, and nothing is made up."""

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


def test_what_was_asked_for_comes_through() -> None:
    """Names in one form, the phrase as scorers read it, the rest as it was said; unknown fields are nobody's business."""
    found = parsed(said(BLADE | {"colour": "grey"}, GRIP, mood="good"))
    assert (found.name, found.category, found.task, found.backend) == ("thing_1", "bread_knife", "cut bread", "vlm")
    edge, grip = found.notes
    assert (edge.part, edge.role, edge.reason, edge.confidence) == ("cutting_edge", "negative", "It cuts.", 0.9)
    assert edge.phrase == "the cutting edge of a bread knife, a long flat thin plate"
    assert edge.task_changes and not grip.task_changes


@pytest.mark.parametrize("around", ["{}", "```json\n{}\n```", "Sure! {{here}} it is:\n{}\nAsk me {{more}}.",
                                    "<think>{{1}} {{}}</think>{}"])  # fmt: skip
def test_words_and_fences_around_it_do_not_matter(around: str) -> None:
    """One object is meant."""
    assert parsed(around.format(said(GRIP))) == parsed(said(GRIP))


@pytest.mark.parametrize("category", ["unknown", "Unknown", " unknown object "])
def test_who_does_not_know_the_object_says_nothing_of_it(category: str) -> None:
    """Even with parts."""
    for text in (said(category=category), said(GRIP, category=category), json.dumps({"category": category})):
        assert parsed(text) == PartDescription("thing_1", "unknown", "cut bread", (), "vlm")


@pytest.mark.parametrize("text", ["", "I cannot help with that.", "{", "{" * 5000, '{"a":' * 5000, "[1, 2]", '{"parts": []}',
                                  said(GRIP)[:-2], said(GRIP) + said(BLADE), said(GRIP).replace("0.9", "NaN")])  # fmt: skip
def test_what_is_no_answer_is_one_sentence(text: str) -> None:
    """It names object, task and backend, shows the beginning of what came, and says what to do. Two answers are none."""
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
def test_a_field_that_is_not_as_asked_is_an_error(field: str, values: list[Any]) -> None:
    """Of that part and field: nothing is clipped, turned into another type or left out."""
    for value in values:
        with pytest.raises(ValueError, match=rf"parts\[1\], field '{field}': expected .*, got "):
            parsed(said(GRIP, BLADE | {field: value}))
    with pytest.raises(ValueError, match=rf"parts\[0\], field '{field}'"):
        parsed(said({key: value for key, value in BLADE.items() if key != field}))


@pytest.mark.parametrize("parts", [(), (GRIP, GRIP), (GRIP, GRIP | {"part": "HANDLE "}), ("blade",), (None,)])
def test_parts_are_a_list_of_different_ones(parts: tuple[Any, ...]) -> None:
    """A thing that is known has parts, each once."""
    with pytest.raises(ValueError, match="parts"):
        parsed(said(*parts))
    with pytest.raises(ValueError, match="parts"):
        parsed(json.dumps({"category": "knife", "parts": {"handle": GRIP}}))


def test_neutral_parts_need_no_reason() -> None:
    """And have none, as in the table."""
    assert parsed(said(GRIP | {"role": "neutral", "reason": "whatever"})).notes[0].reason == ""


def test_the_table_said_as_an_answer_is_the_table() -> None:
    """Round trip through the words of another describer."""
    table = look_up("thing_1", "knife", "cut bread")
    parts = [vars(note) | {"looks": note.phrase.partition(", ")[2]} for note in table.notes]
    assert parsed(said(*parts, category=table.category)).notes == table.notes


@given(st.text())
def test_any_text_is_an_answer_or_one_sentence(text: str) -> None:
    """Nothing but ValueError, on one line that can be written down."""
    for around in (text, json.dumps({"category": text, "parts": [GRIP | {"part": text, "looks": text}]})):
        try:
            found = parsed(around)
        except ValueError as error:
            assert str(error).encode() and "\n" not in str(error)
        else:
            assert found.category == "unknown" or found.notes[0].phrase.isprintable()


@given(st.recursive(st.none() | st.booleans() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x), max_leaves=8))
def test_objects_are_found_in_text(value: Any) -> None:
    """The outermost ones."""
    assert list(json_objects(f"so {json.dumps({'v': value})} and")) == [{"v": value}]


def test_the_question_tells_what_is_known() -> None:
    """Category, task and sides; what could break out of its line is quoted."""
    full = part_prompt("soldering_iron", 'say "x"\nand y', ("front", "back"))
    assert '"soldering iron"' in full and r'"say \"x\"\nand y"' in full and "front, back" in full
    empty = part_prompt("", "", ("front",))
    assert LOOK_WORDS in full and LOOK_WORDS in empty
    assert "Somebody says" not in empty and "No task is given" in empty
    example = empty[empty.index('{"category": "unknown"') :]
    assert parsed(example).category == "unknown"


def test_the_words_for_looks_are_those_that_the_scorer_learned() -> None:
    """Each stands in the table of looks, and nearly all that the table says can be said with them."""
    learned, offered = words(*LOOKS.values(), *LOOKS_OF.values()), set(words(LOOK_WORDS))
    assert offered <= set(learned)
    assert sum(word in offered | {"a", "of", "with"} for word in learned) > 0.95 * len(learned)


def words(*texts: str) -> list[str]:
    """Without the s of the plural."""
    return [word.rstrip("s") for word in re.findall(r"[a-z]+", " ".join(texts))]
