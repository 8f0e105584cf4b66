"""Uses of objects that their owner writes down: for an object and a task, parts to hold and parts to avoid.

A line is `object | task | parts to hold | parts to avoid`, parts separated by `;`. A part is a word of the lexicon (handle, rim,
blade), or any name with its shape: `cap = a short thick tube at the end`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

from afford.surface.describe.household import SHAPES, household_category, shape_of
from afford.surface.describe.looks import LOOKS, word_phrase
from schemas.mesh import ObjectMesh
from schemas.surface import PartDescription, PartNote

Role = Literal["negative", "positive", "neutral"]
BACKEND = "uses"
"""name of the describer in descriptions"""


class Use(NamedTuple):
    """One line."""

    object: str
    task: str
    hold: dict[str, str]
    """part -> its shape in words, '' for that of the lexicon"""
    avoid: dict[str, str]


def parse_use(line: str) -> Use:
    """Parse a line. ValueError, one sentence, for another form, a line without parts, or a part in both columns."""
    cells = [cell.strip() for cell in line.split("|")]
    if len(cells) != 4 or not cells[0]:
        raise ValueError(f"use {line!r}: expected object | task | parts to hold | parts to avoid, got {len(cells)} columns")
    hold, avoid = (dict(_part(word) for word in cell.split(";") if word.strip()) for cell in cells[2:])
    if (not hold and not avoid) or hold.keys() & avoid.keys():
        raise ValueError(f"use {line!r}: expected parts to hold or to avoid, each in one column, got "
                         f"{', '.join(hold.keys() & avoid.keys()) or 'none'}")
    return Use(cells[0], cells[1], hold, avoid)


def described(mesh: ObjectMesh, lines: Iterable[str]) -> tuple[PartDescription, ...]:
    """Describe an object by the lines with its name or category; empty without one. ValueError for a part of unknown shape."""
    uses = [parse_use(line) for line in lines]
    return tuple(PartDescription(mesh.name, mesh.category or mesh.name, one.task, tuple(_notes(mesh, one, uses)), BACKEND)
                 for one in uses if one.object in (mesh.name, mesh.category))  # fmt: skip


def _part(word: str) -> tuple[str, str]:
    name, _, looks = word.partition("=")
    return name.strip().lower().replace(" ", "_"), looks.strip()


def _notes(mesh: ObjectMesh, use: Use, uses: Iterable[Use]) -> Iterator[PartNote]:
    """Yield notes on the parts of a use; other uses of the object say where a part changes its role."""
    columns: tuple[tuple[Role, str, dict[str, str]], ...] = (
        ("negative", "its owner says that it must not be touched", use.avoid), ("positive", "a hand belongs here", use.hold))
    for role, reason, parts in columns:
        for part, looks in parts.items():
            shape = looks or shape_of(household_category(mesh.category), part)
            if shape is None:
                raise ValueError(f"use of {use.object}, part {part}: expected one of {', '.join(sorted({*LOOKS, *SHAPES}))}, or a "
                                 f"shape, as in '{part} = a short thick tube at the end'")  # fmt: skip
            turns = any(part in (one.hold if role == "negative" else one.avoid) for one in uses if one.object == use.object)
            yield PartNote(part, word_phrase(mesh.category or mesh.name, part, shape), role, reason, 1.0, turns)
