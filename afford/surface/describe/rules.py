"""The embedded lexicon as a describer: a table of things, tasks and parts. It knows its table and nothing else."""

from __future__ import annotations

import re

from afford.surface.describe.lexicon import LEXICON, Rule, role_changes, rule
from afford.surface.describe.looks import PARTS, part_phrase
from afford.surface.describe.task import parse_task
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription, PartNote

SURE, GENERAL = 0.95, 0.7
"""Confidence where the table has the task, and where it only has what holds for any use."""


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: None) -> PartDescription:
    """What the table says of an object by its name and category. It looks at no picture."""
    return look_up(mesh.name, mesh.category, task)


def look_up(name: str, category: str, task: str) -> PartDescription:
    """What the table says of a thing and a task; category 'unknown' and no notes for what is not in it."""
    kind = known_category(category)
    if not kind:
        return PartDescription(name, "unknown", task, (), "rules")
    row = rule(kind, task)
    verb = parse_task(task).verb
    sure = SURE if verb else GENERAL
    notes = tuple(_note(kind, part, row, sure) for part in PARTS[kind].split())
    return PartDescription(name, kind, task, notes, "rules")


def known_category(category: str) -> str:
    """The category as the table writes it ("Soldering iron" is soldering_iron), '' where it is not in it."""
    word = re.sub(r"[^a-z]+", "_", category.lower()).strip("_")
    return word if word in LEXICON else ""


def _note(kind: str, part: str, row: Rule, confidence: float) -> PartNote:
    role, reason = "neutral", ""
    if part in row.negative:
        role, reason = "negative", row.reason
    elif part in row.positive:
        role, reason = "positive", "a hand belongs here"
    return PartNote(part, part_phrase(kind, part), role, reason, confidence, role_changes(kind, part, role == "negative"))
