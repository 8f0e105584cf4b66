"""The embedded lexicon as a describer: a table of things, tasks and parts. It knows its table and nothing else."""

from __future__ import annotations

import re

from afford.backends.describe.lexicon import LEXICON, Rule, changes, rule
from afford.backends.describe.task import parse
from schemas.negative import PartDescription, PartNote

LOOKS = {
    "blade": "the sharp metal blade", "face": "the flat striking face", "claw": "the curved claw",
    "head": "the head", "handle": "the handle", "shaft": "the thin metal shaft", "tip": "the pointed tip", "bit": "the drill bit",
    "chuck": "the round chuck", "body": "the body", "trigger": "the trigger", "battery": "the battery", "rim": "the rim",
    "spout": "the spout", "opening": "the opening of the spout", "lid": "the lid", "plate": "the flat metal plate",
    "cord": "the cord", "nozzle": "the nozzle", "switch": "the switch", "bristles": "the bristles", "tines": "the pointed tines",
    "bowl": "the round bowl", "neck": "the neck", "guard": "the collar",
}  # fmt: skip
"""A part in words; another word for another thing below."""
LOOKS_OF = {
    ("saw", "blade"): "the toothed metal blade", ("trowel", "blade"): "the flat pointed blade",
    ("razor", "head"): "the head across the end", ("axe", "head"): "the blunt metal back of the head",
    ("spatula", "head"): "the flat slotted head", ("brush", "head"): "the back that holds the bristles",
    ("soldering_iron", "shaft"): "the thin metal barrel", ("fork", "neck"): "the metal neck", ("mug", "body"): "the round side",
}  # fmt: skip
WHOLE = {"scissors": "a pair of scissors"}
SURE, GENERAL = 0.95, 0.7
"""Confidence where the table has the task, and where it only has what holds for any use."""


def describe(name: str, category: str, task: str) -> PartDescription:
    """What the table says of a thing and a task; category 'unknown' and no notes for what is not in it."""
    kind = known(category)
    if not kind:
        return PartDescription(name, "unknown", task, (), "rules")
    row = rule(kind, task)
    verb = parse(task).verb
    sure = SURE if verb else GENERAL
    judged = [*((part, True) for part in row.negative), *((part, False) for part in row.positive)]
    notes = tuple(_note(kind, part, negative, row, sure) for part, negative in judged)
    return PartDescription(name, kind, task, notes, "rules")


def known(category: str) -> str:
    """The category as the table writes it ("Soldering iron" is soldering_iron), '' where it is not in it."""
    word = re.sub(r"[^a-z]+", "_", category.lower()).strip("_")
    return word if word in LEXICON else ""


def _note(kind: str, part: str, negative: bool, row: Rule, confidence: float) -> PartNote:
    reason = row.reason if negative else "a hand belongs here"
    return PartNote(part, phrase(kind, part), negative, reason, confidence, changes(kind, part, negative))


def phrase(kind: str, part: str) -> str:
    """A part in words, e.g. 'the toothed metal blade of a saw'."""
    whole = kind.replace("_", " ")
    article = "an" if whole[0] in "aeiou" else "a"
    return f"{LOOKS_OF.get((kind, part), LOOKS[part])} of {WHOLE.get(kind, f'{article} {whole}')}"
