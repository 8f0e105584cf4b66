"""Second table of the lexicon: household vessels and packages, and other names of known categories.

Rows have the form of lexicon.py, which grasp_tasks reads and which shipped policies were trained on; this table serves the
user's meshes and household bodies only. A category of both tables has the rows of lexicon.py.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from afford.surface.describe.lexicon import (
    EATEN,
    GENERAL,
    LEXICON,
    SURE,
    TAKES,
    TASKS,
    WASHED,
    Rule,
    known_category,
    look_up,
    negative_parts,
    parse_task,
)
from afford.surface.describe.looks import LOOKS, LOOKS_OF, PARTS, word_phrase
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription, PartNote

CLOSED, POURED = "it opens only while no hand holds it", "what is poured passes it"
DRUNK, FREE = "the lips touch it", "who takes it needs this part free"
EMPTY = "empty, it may be held anywhere"
ROWS: dict[str, tuple[tuple[str, str, str, str, str], ...]] = {
    # verb, state, must not be touched, where the hand belongs, why
    "bottle": (
        ("",          "",    "",            "body",        EMPTY),
        ("pour",      "",    "neck cap",    "body",        POURED),
        ("drink",     "",    "neck cap",    "body",        DRUNK),
        ("screw",     "",    "cap",         "body",        CLOSED),
        ("hand over", "",    "cap",         "body",        FREE),
    ),
    "bowl": (
        ("",          "",    "",            "rim",         "a wide bowl is held by its wall"),
        ("eat",       "",    "rim",         "body",        DRUNK),
        ("carry",     "hot", "body",        "rim",         "it is hot and burns the hand"),
        ("wash",      "",    "",            "rim body",    WASHED),
        ("hand over", "",    "rim",         "body",        FREE),
    ),
    "box": (
        ("",          "",    "",            "body",        EMPTY),
        ("pour",      "",    "lid",         "body",        POURED),
        ("hand over", "",    "lid",         "body",        FREE),
    ),
    "bucket": (
        ("",          "",    "rim",         "handle",      "the edge of a full bucket cuts into the hand"),
        ("wash",      "",    "",            "handle body", WASHED),
        ("hand over", "",    "handle",      "rim",         TAKES),
    ),
    "can": (
        ("",          "",    "",            "body",        EMPTY),
        ("drink",     "",    "lid",         "body",        DRUNK),
        ("pour",      "",    "lid",         "body",        "the edge of an opened lid is sharp"),
        ("hand over", "",    "lid",         "body",        FREE),
    ),
    "carton": (
        ("",          "",    "cap",         "body",        CLOSED),
        ("pour",      "",    "cap top",     "body",        POURED),
        ("hand over", "",    "body",        "top",         FREE),
    ),
    "cup": (
        ("",          "",    "rim",         "body",        DRUNK),
        ("carry",     "",    "",            "body rim",    EMPTY),
        ("wash",      "",    "",            "rim body",    WASHED),
        ("hand over", "",    "rim",         "body",        FREE),
    ),
    "jar": (
        ("",          "",    "",            "body lid",    EMPTY),
        ("screw",     "",    "lid",         "body",        CLOSED),
        ("hand over", "",    "body",        "lid",         FREE),
    ),
    "jug": (
        ("",          "",    "cap",         "handle",      CLOSED),
        ("pour",      "",    "cap",         "handle",      POURED),
        ("carry",     "",    "",            "handle body", EMPTY),
        ("hand over", "",    "handle cap",  "body",        TAKES),
    ),
    "pitcher": (
        ("",          "",    "rim spout",   "handle",      DRUNK),
        ("pour",      "",    "rim spout",   "handle",      POURED),
        ("carry",     "",    "rim spout",   "handle body", DRUNK),
        ("wash",      "",    "",            "handle rim body", WASHED),
        ("hand over", "",    "handle",      "body",        TAKES),
    ),
    "plate": (
        ("",          "",    "body",        "rim",         EATEN),
        ("wash",      "",    "",            "rim body",    WASHED),
    ),
    "soap_dispenser": (
        ("",          "",    "nozzle",      "head",        "it spurts: a finger there is hit"),
        ("carry",     "",    "head nozzle", "body",        "a touch of the head makes it spurt"),
        ("fill",      "",    "head nozzle", "body neck",   "a touch of the head makes it spurt"),
        ("hand over", "",    "head nozzle", "body",        FREE),
    ),
    "spoon": (
        ("",          "",    "bowl",        "handle",      EATEN),
        ("wash",      "",    "",            "handle bowl", WASHED),
        ("hand over", "",    "handle bowl", "neck",        TAKES),
    ),
    "tube": (
        ("",          "",    "cap",         "body",        CLOSED),
        ("carry",     "",    "",            "body cap",    "a closed tube may be held anywhere"),
        ("hand over", "",    "cap",         "body",        FREE),
    ),
}  # fmt: skip
PARTS_OF = {
    "bottle": "body neck cap", "bowl": "body rim", "box": "body lid", "bucket": "handle body rim", "can": "body lid",
    "carton": "body top cap", "cup": "body rim", "jar": "body lid", "jug": "handle body cap", "pitcher": "handle body rim spout",
    "plate": "body rim", "soap_dispenser": "body neck head nozzle", "spoon": "handle neck bowl", "tube": "body cap",
}  # fmt: skip
"""parts of each category"""
USES_OF: dict[str, tuple[str, ...]] = {
    "bottle": ("pour water", "unscrew the bottle", "put away the bottle"),
    "bowl": ("carry the bowl", "eat soup", "hand over the bowl"),
    "box": ("pour cereal", "put away the box", "hand over the box"),
    "bucket": ("carry the bucket", "hand over the bucket"),
    "can": ("drink lemonade", "put away the can", "hand over the can"),
    "carton": ("pour milk", "put away the carton", "hand over the carton"),
    "cup": ("drink water", "put away the cup", "hand over the cup"),
    "jar": ("unscrew the jar", "put away the jar", "hand over the jar"),
    "jug": ("pour milk", "put away the jug", "hand over the jug"),
    "pitcher": ("pour water", "wash the pitcher", "hand over the pitcher"),
    "plate": ("carry the plate", "wash the plate"),
    "soap_dispenser": ("press out soap", "fill the soap dispenser", "hand over the soap dispenser"),
    "spoon": ("stir tea", "wash the spoon", "hand over the spoon"),
    "tube": ("spread toothpaste", "put away the tube", "hand over the tube"),
}
"""tasks of each category"""
SHAPES = {"cap": "a short thick tube at the end", "top": "a wedge on top"}
"""shape of a part that `LOOKS` lacks"""
SHAPES_OF = {
    ("bottle", "body"): "a large tall block at the bottom",
    ("bottle", "neck"): "a short thick tube at the end", ("bowl", "body"): "a round hollow bowl at the bottom",
    ("box", "body"): "a large box at the bottom", ("box", "lid"): "a flat block on top", ("bucket", "handle"): "a loop on top",
    ("can", "body"): "a thick cylinder at the bottom", ("carton", "body"): "a large box at the bottom",
    ("carton", "cap"): "a small disc on the side", ("cup", "body"): "a round hollow vessel at the bottom",
    ("jar", "body"): "a thick cylinder at the bottom", ("jug", "handle"): "a loop on the side",
    ("jug", "body"): "a large round vessel", ("pitcher", "handle"): "a loop on the side",
    ("pitcher", "spout"): "a small wedge on the side", ("plate", "body"): "a large flat round disc in the middle",
    ("plate", "rim"): "a thin ring around the top", ("soap_dispenser", "body"): "a large tall block at the bottom",
    ("soap_dispenser", "neck"): "a short ring in the middle", ("soap_dispenser", "head"): "a small disc on top",
    ("soap_dispenser", "nozzle"): "a thin curved tube on the side", ("spoon", "handle"): "a long thin bar at the end",
    ("spoon", "neck"): "a thin bar in the middle", ("spoon", "bowl"): "a small round hollow bowl at the end",
    ("tube", "body"): "a long thick wedge in the middle",
}  # fmt: skip
"""(object, part) -> shape, where it differs from `LOOKS` and `SHAPES`"""
SAME_AS = {
    "cleanser": "bottle", "flask": "bottle", "thermos": "bottle", "basin": "bowl", "package": "box", "pail": "bucket", "tin": "can",
    "beaker": "cup", "cups": "cup", "tumbler": "cup", "canister": "jug", "jerrycan": "jug", "carafe": "pitcher",
    "watering_can": "pitcher", "skillet": "pan", "frying_pan": "pan", "saucepan": "pan", "teakettle": "kettle", "saucer": "plate",
    "pump": "soap_dispenser", "toothpaste": "tube", "wineglass": "wine_glass", "torch": "flashlight", "spray": "spray_bottle",
}
"""other name -> category"""
OTHER_THINGS = ("cutter", "lid", "opener", "rack")
"""last words of names of things that are in no table: a can opener is no can"""


def category_words() -> tuple[str, ...]:
    """Return the words that are looked for in the name of a mesh: categories of both tables, other names, and other things."""
    return tuple(dict.fromkeys((*PARTS, *PARTS_OF, *SAME_AS, *OTHER_THINGS)))


def household_category(category: str) -> str:
    """Return the category of either table, '' for an unknown one ("Skillet" is pan)."""
    word = re.sub(r"[^a-z]+", "_", category.lower()).strip("_")
    same = SAME_AS.get(word, word)
    return known_category(same) or (same if same in ROWS else "")


def uses_of(category: str) -> tuple[str, ...]:
    """Return the tasks of a category; empty for an unknown one."""
    kind = household_category(category)
    return TASKS.get(kind) or USES_OF.get(kind, ())


def shape_of(category: str, part: str) -> str | None:
    """Return the shape of a part in words; None for a part that no table has."""
    return SHAPES_OF.get((category, part)) or LOOKS_OF.get((category, part)) or LOOKS.get(part) or SHAPES.get(part)


def household_rule(category: str, task: str) -> Rule:
    """Return the row for a task of a category of this table; KeyError for another one."""
    parsed, rows = parse_task(task), {(row.verb, row.state): row for row in _rows(category)}
    wanted = ((parsed.verb, parsed.state), (parsed.verb, ""), ("", parsed.state), ("", ""))
    return next(rows[key] for key in wanted if key in rows)


def household_negative(category: str, task: str) -> frozenset[str]:
    """Return the negative parts of a task in either table, for evaluation; KeyError for an unknown category."""
    return negative_parts(category, task) if category in LEXICON else frozenset(household_rule(category, task).negative)


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: None) -> PartDescription:
    """Describe an object by its name and category (`Describer`); the views are not used."""
    return household_look_up(mesh.name, mesh.category, task)


def household_look_up(name: str, category: str, task: str) -> PartDescription:
    """Describe an object for a task; category 'unknown' and no notes for a category outside both tables."""
    kind = household_category(category)
    if not kind or kind in LEXICON:
        return look_up(name, kind, task)
    return PartDescription(name, kind, task, tuple(_notes(kind, task)), "rules")


def _rows(category: str) -> tuple[Rule, ...]:
    return tuple(Rule(verb, state, tuple(negative.split()), tuple(positive.split()), reason)
                 for verb, state, negative, positive, reason in ROWS[category])  # fmt: skip


def _notes(kind: str, task: str) -> Iterator[PartNote]:
    row, confidence = household_rule(kind, task), SURE if parse_task(task).verb else GENERAL
    for part in PARTS_OF[kind].split():
        negative = part in row.negative
        changes = any((part in other.negative) != negative for other in _rows(kind))
        phrase = word_phrase(kind, part, shape_of(kind, part) or part)
        if negative:
            yield PartNote(part, phrase, "negative", row.reason, confidence, changes)
        elif part in row.positive:
            yield PartNote(part, phrase, "positive", "a hand belongs here", confidence, changes)
        else:
            yield PartNote(part, phrase, "neutral", "", confidence, changes)
