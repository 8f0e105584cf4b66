"""Prompt for a vision-language model about the parts of an object and a task, and the parser of its JSON answer.

AffordDex asks for one part that must not be touched, independent of the task. This prompt contains the task and asks for all parts.
The parser reports every deviation from the form in one sentence and fills in nothing.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from afford.surface.describe.looks import word_phrase
from schemas.surface import PartDescription, PartNote

PROMPT = """\
The picture shows one object from these sides, row by row: {sides}.{stated}
{task}

Say what the object is. Then name every part of it that has a shape of its own, and judge for each whether a bare hand
- must not touch it during this task ("negative": it cuts, burns, catches, breaks, must stay clean, or must stay free for others),
- belongs there ("positive"), or
- may touch it, but need not ("neutral").

Answer with one JSON object and nothing else:
{{"category": "what the object is, one or two words",
 "parts": [{{"part": "its name, one word",
            "role": "negative, positive or neutral",
            "looks": "its shape and place, such as: a long flat thin plate at the end",
            "reason": "why, in one sentence",
            "confidence": a number from 0 to 1,
            "task_changes": true if another task with this object would turn the role round, else false}}]}}
For "looks" use few plain words, these where they fit: {words}.
If you do not know what the object is, do not guess; answer {{"category": "unknown", "parts": []}}
"""


LOOK_WORDS = """\
long, short, tall, thin, thick, large, small, wide, flat, round, curved, bent, pointed, shallow, hollow, bar, block, plate, disc,
dish, ring, loop, hook, rod, wire, tube, cylinder, cone, ball, box, bowl, dome, vessel, wedge; at the end, at the very end, across
the end, in the middle, on top, around the top, on the side, on both sides, below, at the bottom"""
"""words of looks.py, on which the embedded scorer is trained"""


def part_prompt(category: str, task: str, sides: Sequence[str]) -> str:
    """Write the prompt about an object of a `category` ('' for an unknown one) and a task ('' for any use).

    `sides` are the names of the views in the image, row by row.
    """
    stated = f" Somebody says that it is this: {_quote(category.replace('_', ' '))}." if category else ""
    doing = f"The task: {_quote(task)}." if task else "No task is given: think of its usual use."
    return PROMPT.format(sides=", ".join(sides), stated=stated, task=doing, words=LOOK_WORDS)


def _quote(text: str) -> str:
    """Quote text on one line."""
    return json.dumps(text, ensure_ascii=False)


ROLES = ("negative", "positive", "neutral")
UNKNOWN = "unknown"
QUOTED = 200
"""characters of an answer in an error message"""
ADVICE = "ask a model that follows instructions; raise new_tokens if the answer was cut off"


def parse_answer(text: str, name: str, task: str, backend: str) -> PartDescription:
    """Parse the description in an answer; words or a code fence around the JSON are ignored.

    Raises ValueError for an answer without a JSON object or with several, and for a field that violates the form. For the category
    'unknown' the description has no parts.
    """
    where = f"{name}, {task or 'any use'}: answer of backend {backend!r}"
    found = [value for value in json_objects(text) if "category" in value]
    if len(found) != 1:
        wanted = "one JSON object with category and parts"
        raise ValueError(f"{where}: expected {wanted}, got {len(found)} in {text[:QUOTED]!r}; {ADVICE}")
    category = _name(found[0], "category", where)
    if category.startswith(UNKNOWN):
        return PartDescription(name, UNKNOWN, task, (), backend)
    parts = found[0].get("parts")
    if not isinstance(parts, list) or not parts:
        _refuse(f"{where}, field 'parts'", "a list of at least one part", parts)
    notes = tuple(_note(part, category, f"{where}, parts[{n}]") for n, part in enumerate(parts))
    names = [note.part for note in notes]
    if len(set(names)) < len(names):
        _refuse(f"{where}, field 'parts'", "every part once", names)
    return PartDescription(name, category, task, notes, backend)


def json_objects(text: str) -> Iterator[dict[str, Any]]:
    """Yield the outermost JSON objects in a text, in order."""
    decoder, at = json.JSONDecoder(parse_constant=_no_number), text.find("{")
    while at >= 0:
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):  # a brace that begins no object: the next one may
            end = at + 1
        else:
            yield value
        at = text.find("{", end)


def normalise_name(name: str) -> str:
    """Convert 'Cutting edge' to cutting_edge: lower case, one _ for each run of other characters."""
    return re.sub(r"[\W_]+", "_", name.lower()).strip("_")


def _note(part: Any, category: str, where: str) -> PartNote:
    if not isinstance(part, dict):
        _refuse(where, "an object", part)
    role = part.get("role")
    if role not in ROLES:
        _refuse(f"{where}, field 'role'", f"one of {', '.join(ROLES)}", role)
    changes = part.get("task_changes")
    if not isinstance(changes, bool):
        _refuse(f"{where}, field 'task_changes'", "true or false", changes)
    name = _name(part, "part", where)
    reason = "" if role == "neutral" else _text(part, "reason", where)
    return PartNote(name, word_phrase(category, name, _text(part, "looks", where)), role, reason, _confidence(part, where), changes)


def _confidence(part: dict[str, Any], where: str) -> float:
    value = part.get("confidence")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 1:
        _refuse(f"{where}, field 'confidence'", "a number from 0 to 1", value)
    return float(value)


def _name(holder: dict[str, Any], key: str, where: str) -> str:
    name = normalise_name(_text(holder, key, where))
    return name or _refuse(f"{where}, field {key!r}", "a name with letters", holder[key])


def _text(holder: dict[str, Any], key: str, where: str) -> str:
    """Return a field as one line of printable text."""
    value = holder.get(key)
    line = " ".join(value.split()) if isinstance(value, str) else ""
    return line if line and line.isprintable() else _refuse(f"{where}, field {key!r}", "some words", value)


def _refuse(where: str, expected: str, got: object) -> NoReturn:
    raise ValueError(f"{where}: expected {expected}, got {repr(got)[:QUOTED]}; {ADVICE}")


def _no_number(word: str) -> NoReturn:
    raise ValueError(word)
