"""The embedded lexicon as a describer: a table of things, tasks and parts. It knows its table and nothing else."""

from __future__ import annotations

import re

from afford.surface.describe.lexicon import LEXICON, Rule, changes, rule
from afford.surface.describe.looks import PARTS, phrase
from afford.surface.describe.task import parse
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription, PartNote

SURE, GENERAL = 0.95, 0.7
"""Confidence where the table has the task, and where it only has what holds for any use."""


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: None) -> PartDescription:
    """What the table says of an object by its name and category. It looks at no picture."""
    return look_up(mesh.name, mesh.category, task)


def look_up(name: str, category: str, task: str) -> PartDescription:
    """What the table says of a thing and a task; category 'unknown' and no notes for what is not in it."""
    kind = known(category)
    if not kind:
        return PartDescription(name, "unknown", task, (), "rules")
    row = rule(kind, task)
    verb = parse(task).verb
    sure = SURE if verb else GENERAL
    notes = tuple(_note(kind, part, row, sure) for part in PARTS[kind].split())
    return PartDescription(name, kind, task, notes, "rules")


def known(category: str) -> str:
    """The category as the table writes it ("Soldering iron" is soldering_iron), '' where it is not in it."""
    word = re.sub(r"[^a-z]+", "_", category.lower()).strip("_")
    return word if word in LEXICON else ""


def _note(kind: str, part: str, row: Rule, confidence: float) -> PartNote:
    if part in row.negative:
        return PartNote(part, phrase(kind, part), "negative", row.reason, confidence, changes(kind, part, True))
    if part in row.positive:
        return PartNote(part, phrase(kind, part), "positive", "a hand belongs here", confidence, changes(kind, part, False))
    return PartNote(part, phrase(kind, part), "neutral", "", confidence, changes(kind, part, False))
