"""The answer of a model -> a typed description, or one sentence that says what is wrong with it. Nothing is filled in."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, NoReturn

from afford.surface.describe.looks import word_phrase
from schemas.surface import PartDescription, PartNote

ROLES = ("negative", "positive", "neutral")
UNKNOWN = "unknown"
QUOTED = 200
"""characters of an answer that an error shows"""
ADVICE = "ask a model that follows instructions; raise new_tokens if the answer was cut off"


def parse_answer(text: str, name: str, task: str, backend: str) -> PartDescription:
    """The description in an answer, which may have words or a fence around its JSON; ValueError when there is none, or more than
    one, or a field is not what was asked for. Who does not know the object says nothing of its parts.
    """
    where = f"{name}, {task or 'any use'}: answer of backend {backend!r}"
    found = [value for value in json_objects(text) if "category" in value]
    if len(found) != 1:
        wanted = "one JSON object with category and parts"
        raise ValueError(f"{where}: expected {wanted}, got {len(found) or 'none'} in {text[:QUOTED]!r}; {ADVICE}")
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
    """The outermost JSON objects in a text, in order."""
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
    """'Cutting edge' is cutting_edge: small letters, one _ for all that is neither letter nor digit."""
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
    """One line of text that can be printed: no control characters, no halves of characters."""
    value = holder.get(key)
    line = " ".join(value.split()) if isinstance(value, str) else ""
    return line if line and line.isprintable() else _refuse(f"{where}, field {key!r}", "some words", value)


def _refuse(where: str, expected: str, got: object) -> NoReturn:
    raise ValueError(f"{where}: expected {expected}, got {repr(got)[:QUOTED]}; {ADVICE}")


def _no_number(word: str) -> NoReturn:
    raise ValueError(word)
