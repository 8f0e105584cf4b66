"""Embedded lexicon as a describer: negative and positive parts of each object category and task, one row each.

A row holds for one verb of `VERBS` ('' for any use) and one state (hot, cold; '' for either). `rule` selects the most specific row:
verb and state, then the verb alone, then the state alone, then any use. Parts are those of afford/synthetic/objects. The lexicon
reads category and task only; it uses no image.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from afford.surface.describe.looks import PARTS, part_phrase
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription, PartNote

VERBS = {
    "hand over": ("hand over", "hand me", "hand him", "hand her", "hand them", "pass", "give", "offer"),
    "wash": ("wash", "rinse", "clean", "dry", "wipe", "polish"),
    "carry": ("carry", "move", "fetch", "bring", "take", "lift", "pick up", "put away", "place", "store"),
    "cut": ("cut", "slice", "chop", "carve", "peel", "trim", "saw", "split", "shave", "mince", "snip", "chisel"),
    "drink": ("drink", "sip"),
    "pour": ("pour",),
    "fill": ("fill", "refill"),
    "cook": ("cook", "fry", "boil", "simmer", "heat", "roast"),
    "stir": ("stir", "serve", "scoop", "ladle", "flip", "turn over", "lift out"),
    "eat": ("eat",),
    "press": ("iron", "press", "smooth"),
    "drive": ("drive", "hammer", "knock", "pound", "nail", "hit"),
    "pull": ("pull", "pull out", "pry", "remove"),
    "screw": ("screw", "unscrew", "fasten", "tighten", "loosen", "turn"),
    "bore": ("drill", "bore"),
    "change bit": ("change the bit", "change bit", "change the battery", "change battery", "charge"),
    "solder": ("solder", "desolder"),
    "spread": ("spread", "lay", "plaster", "dig", "plant"),
    "scrub": ("scrub", "brush", "sweep"),
    "blow": ("blow", "blow-dry", "dry hair", "style"),
    "grip": ("grip", "clamp", "bend", "crimp"),
    "roll": ("roll", "flatten"),
    "paint": ("paint",),
    "spray": ("spray", "mist"),
    "light": ("light", "shine", "ignite"),
}
"""verb -> phrases at the start of a task that mean it; the longest matching phrase decides"""
HOT = ("hot", "boiling", "steaming", "heated", "glowing", "burning", "lit")
COLD = ("cold", "cool", "cooled", "iced", "unplugged", "unheated")
STATES = {**dict.fromkeys(HOT, "hot"), **dict.fromkeys(COLD, "cold")}


@dataclass(frozen=True)
class ParsedTask:
    """Verb and state of a task.

    `verb` is a key of VERBS, '' for an unknown one. `state` is hot, cold, or '' for a task that names neither.
    """

    verb: str
    state: str


def parse_task(text: str) -> ParsedTask:
    """Parse the verb and the state of a task.

    The last state word decides: "pour the hot tea from the cold kettle" is about a cold kettle.
    """
    words = re.findall(r"[a-z]+(?:-[a-z]+)?", text.lower())
    line = " ".join(words)
    fits = [(len(phrase), verb) for verb, phrases in VERBS.items() for phrase in phrases if f"{line} ".startswith(f"{phrase} ")]
    states = [STATES[word] for word in words if word in STATES]
    return ParsedTask(max(fits)[1] if fits else "", states[-1] if states else "")


@dataclass(frozen=True)
class Rule:
    """One row of the lexicon."""

    verb: str
    state: str
    negative: tuple[str, ...]
    positive: tuple[str, ...]
    reason: str


def _row(verb: str, state: str, negative: str, positive: str, reason: str) -> Rule:
    return Rule(verb, state, tuple(negative.split()), tuple(positive.split()), reason)


SHARP, TAKES = "the edge is sharp and cuts the hand", "who takes it needs the handle free, and the giver keeps the danger"
BURNS, SPINS = "it is hot and burns the hand", "it spins and catches the hand"
EATEN, DIRTY = "it touches food", "it is wet or dirty in use"
FLAME, WASHED = "the flame and the melted wax burn the hand", "it is washed all over"

# fmt: off
LEXICON: dict[str, tuple[Rule, ...]] = {
    # verb, state, must not be touched, where the hand belongs, why
    "knife": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "cleaver": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "scissors": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "saw": (
        _row("",           "",     "blade",                "handle",       "the teeth tear the skin"),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "chisel": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "razor": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle blade",         "head",         TAKES),
    ),
    "axe": (
        _row("",           "",     "blade",                "handle",       SHARP),
        _row("hand over",  "",     "handle blade",         "head",         TAKES),
    ),
    "hammer": (
        _row("",           "",     "face",                 "handle",       "it strikes: a finger there is crushed"),
        _row("pull",       "",     "claw",                 "handle",       "the claw grips the nail: a finger there is pinched"),
        _row("hand over",  "",     "handle",               "head",         TAKES),
    ),
    "screwdriver": (
        _row("",           "",     "shaft tip",            "handle",       "the tip slips off the screw and stabs"),
        _row("hand over",  "",     "handle",               "shaft",        TAKES),
    ),
    "drill": (
        _row("",           "",     "chuck bit",            "handle",       SPINS),
        _row("change bit", "",     "trigger",              "chuck body",   "a touch of the trigger starts it"),
        _row("hand over",  "",     "handle trigger bit",   "body battery", TAKES),
    ),
    "soldering_iron": (
        _row("",           "",     "shaft tip",            "handle",       BURNS),
        _row("",           "cold", "tip",                  "handle",       "grease on the tip keeps the solder off"),
        _row("hand over",  "",     "shaft tip handle",     "guard",        "the tip burns, and who takes it needs the handle"),
        _row("hand over",  "cold", "handle",               "shaft",        TAKES),
    ),
    "trowel": (
        _row("",           "",     "blade",                "handle",       DIRTY),
        _row("hand over",  "",     "handle",               "blade",        TAKES),
    ),
    "mug": (
        _row("",           "",     "rim",                  "handle body",  "the lips touch the rim"),
        _row("",           "hot",  "body rim",             "handle",       BURNS),
        _row("hand over",  "",     "rim handle",           "body",         TAKES),
        _row("hand over",  "hot",  "body rim",             "handle",       BURNS),
    ),
    "pan": (
        _row("",           "",     "body",                 "handle",       BURNS),
        _row("",           "cold", "",                     "handle body",  "a cold pan may be held anywhere"),
        _row("wash",       "",     "",                     "handle body",  "it is washed cold, and held where it is easy"),
        _row("wash",       "hot",  "body neck",            "handle",       BURNS),
        _row("hand over",  "",     "body",                 "handle",       BURNS),
        _row("hand over",  "cold", "handle",               "body",         TAKES),
    ),
    "pot": (
        _row("",           "",     "body lid",             "handle",       BURNS),
        _row("",           "cold", "",                     "handle body",  "a cold pot may be held anywhere"),
        _row("wash",       "",     "",                     "handle body",  "it is washed cold, and held where it is easy"),
        _row("hand over",  "cold", "handle",               "body",         TAKES),
    ),
    "kettle": (
        _row("",           "",     "body spout opening lid", "handle",     BURNS),
        _row("",           "cold", "opening",              "handle body",  "what is drunk later passes the opening"),
        _row("fill",       "",     "opening",              "handle body",  "what is drunk later passes the opening"),
        _row("fill",       "hot",  "body spout opening lid", "handle",     BURNS),
        _row("wash",       "",     "",                     "handle body",  "it is washed cold, and held where it is easy"),
        _row("hand over",  "cold", "handle",               "body",         TAKES),
    ),
    "ladle": (
        _row("",           "",     "bowl",                 "handle",       EATEN),
        _row("wash",       "",     "",                     "handle bowl",  WASHED),
        _row("hand over",  "",     "handle bowl",          "",             TAKES),
    ),
    "iron": (
        _row("",           "",     "plate",                "handle",       BURNS),
        _row("",           "cold", "cord",                 "handle body",  "a cord that is pulled breaks"),
        _row("wash",       "",     "cord",                 "handle body",  "a plug or cord must not be wet"),
        _row("hand over",  "cold", "handle",               "body",         TAKES),
    ),
    "hair_dryer": (
        _row("",           "",     "nozzle",               "handle",       BURNS),
        _row("",           "cold", "switch",               "handle body",  "a touch of the switch starts it"),
        _row("hand over",  "",     "nozzle handle",        "body",         "the nozzle burns, and who takes it needs the handle"),
    ),
    "brush": (
        _row("",           "",     "bristles",             "handle",       DIRTY),
        _row("hand over",  "",     "handle bristles",      "head",         TAKES),
    ),
    "spatula": (
        _row("",           "",     "head",                 "handle",       EATEN),
        _row("wash",       "",     "",                     "handle head",  WASHED),
        _row("hand over",  "",     "handle head",          "shaft",        TAKES),
    ),
    "fork": (
        _row("",           "",     "tines",                "handle",       "the tines are pointed and touch food"),
        _row("wash",       "",     "tines",                "handle",       "the tines are pointed"),
        _row("hand over",  "",     "handle tines",         "neck",         TAKES),
    ),
    "pliers": (
        _row("",           "",     "jaw pivot",            "handle",       "they close on what is between them"),
        _row("hand over",  "",     "handle",               "jaw",          TAKES),
    ),
    "wrench": (
        _row("",           "",     "jaw",                  "handle",       "it holds the nut: a finger there is pinched"),
        _row("hand over",  "",     "handle",               "jaw",          TAKES),
    ),
    "shovel": (
        _row("",           "",     "blade",                "handle shaft", DIRTY),
        _row("hand over",  "",     "handle blade",         "shaft",        TAKES),
    ),
    "paint_roller": (
        _row("",           "",     "roller",               "handle",       DIRTY),
        _row("wash",       "",     "",                     "handle roller", WASHED),
        _row("hand over",  "",     "handle roller",        "shaft",        TAKES),
    ),
    "wine_glass": (
        _row("",           "",     "rim bowl",             "stem",         "the hand warms the wine, and the lips touch the rim"),
        _row("wash",       "",     "stem foot",            "bowl",         "a stem that is held while the bowl is turned snaps"),
        _row("carry",      "",     "rim",                  "stem",         "the lips touch the rim"),
        _row("hand over",  "",     "rim stem",             "foot",         "who takes it needs the stem free"),
    ),
    "teapot": (
        _row("",           "",     "body spout lid",       "handle",       BURNS),
        _row("",           "cold", "spout",                "handle body",  "what is drunk later passes the spout"),
        _row("fill",       "",     "spout",                "handle knob",  "what is drunk later passes the spout"),
        _row("fill",       "hot",  "body spout lid",       "handle knob",  BURNS),
        _row("wash",       "",     "",                     "handle body",  "it is washed cold, and held where it is easy"),
        _row("hand over",  "",     "body spout lid",       "handle",       BURNS),
        _row("hand over",  "cold", "handle",               "body",         TAKES),
    ),
    "pizza_cutter": (
        _row("",           "",     "wheel",                "handle",       SHARP),
        _row("hand over",  "",     "handle wheel",         "neck guard",   TAKES),
    ),
    "rolling_pin": (
        _row("",           "",     "roller",               "handle",       "it turns, and touches food"),
        _row("wash",       "",     "",                     "handle roller", WASHED),
        _row("carry",      "",     "",                     "handle roller", "a rolling pin at rest may be held anywhere"),
        _row("hand over",  "",     "handle",               "roller",       "who takes it needs the handles free"),
    ),
    "toothbrush": (
        _row("",           "",     "head bristles",        "handle",       "it goes into the mouth"),
        _row("hand over",  "",     "handle head bristles", "neck",         "it goes into the mouth of who takes it by the handle"),
    ),
    "spray_bottle": (
        _row("",           "",     "nozzle",               "neck trigger", "it sprays: a finger there is hit"),
        _row("carry",      "",     "trigger nozzle",       "body neck",    "a touch of the trigger sprays"),
        _row("fill",       "",     "trigger nozzle",       "body neck",    "a touch of the trigger sprays"),
        _row("hand over",  "",     "neck trigger nozzle",  "body",         "who takes it needs neck and trigger free"),
    ),
    "flashlight": (
        _row("",           "",     "lens",                 "body",         "a finger there takes the light away"),
        _row("",           "hot",  "lens head",            "body",         BURNS),
        _row("carry",      "",     "switch lens",          "body",         "a touch of the switch lights it"),
        _row("hand over",  "",     "body switch lens",     "head",         "who takes it needs body and switch free"),
    ),
    "candle": (
        _row("",           "",     "wick body",            "handle",       FLAME),
        _row("",           "cold", "wick",                 "handle holder body", "a wick that breaks does not burn"),
        _row("hand over",  "",     "wick body handle",     "holder",       "the flame burns, and who takes it needs the handle"),
        _row("hand over",  "cold", "handle wick",          "holder",       TAKES),
    ),
}
# fmt: on

TASKS: dict[str, tuple[str, ...]] = {
    "knife": ("cut bread", "wash the knife", "hand over the knife"),
    "cleaver": ("chop meat", "hand over the cleaver"),
    "scissors": ("cut paper", "hand over the scissors"),
    "saw": ("saw a board", "hand over the saw"),
    "chisel": ("carve a joint", "hand over the chisel"),
    "razor": ("shave", "hand over the razor"),
    "axe": ("split wood", "hand over the axe"),
    "hammer": ("drive a nail", "pull out a nail", "hand over the hammer"),
    "screwdriver": ("drive a screw", "hand over the screwdriver"),
    "drill": ("drill a hole", "change the bit"),
    "soldering_iron": ("solder a wire", "hand over the cold soldering iron"),
    "trowel": ("spread mortar", "hand over the trowel"),
    "mug": ("drink hot tea", "drink cold water"),
    "pan": ("fry in the hot pan", "carry the cold pan", "hand over the cold pan"),
    "pot": ("carry the hot pot", "wash the pot", "hand over the cold pot"),
    "kettle": ("pour from the hot kettle", "fill the cold kettle"),
    "ladle": ("serve soup", "hand over the ladle"),
    "iron": ("iron a shirt", "hand over the cold iron"),
    "hair_dryer": ("blow-dry hair", "put away the cold hair dryer"),
    "brush": ("scrub a plate", "hand over the brush"),
    "spatula": ("flip an egg", "hand over the spatula"),
    "fork": ("eat pasta", "hand over the fork"),
    "pliers": ("bend a wire", "hand over the pliers"),
    "wrench": ("tighten a bolt", "hand over the wrench"),
    "shovel": ("dig a hole", "hand over the shovel"),
    "paint_roller": ("paint a wall", "hand over the paint roller"),
    "wine_glass": ("drink wine", "wash the wine glass", "hand over the wine glass"),
    "teapot": ("pour from the hot teapot", "fill the cold teapot", "hand over the cold teapot"),
    "pizza_cutter": ("cut a pizza", "hand over the pizza cutter"),
    "rolling_pin": ("roll out dough", "hand over the rolling pin"),
    "toothbrush": ("brush the teeth", "hand over the toothbrush"),
    "spray_bottle": ("spray the plants", "refill the spray bottle", "hand over the spray bottle"),
    "flashlight": ("shine into a corner", "put away the flashlight", "hand over the flashlight"),
    "candle": ("light the candle", "put away the cold candle", "hand over the burning candle"),
}
"""tasks of the evaluation, by category"""


def rule(category: str, task: str) -> Rule:
    """Return the row for a task in words; KeyError for a category outside the lexicon."""
    parsed, rows = parse_task(task), {(row.verb, row.state): row for row in LEXICON[category]}
    wanted = ((parsed.verb, parsed.state), (parsed.verb, ""), ("", parsed.state), ("", ""))
    return next(rows[key] for key in wanted if key in rows)


def role_changes(category: str, part: str, negative: bool) -> bool:
    """Return True if another row of the category gives this part the opposite role."""
    return any((part in row.negative) != negative for row in LEXICON[category])


def negative_parts(category: str, task: str) -> frozenset[str]:
    """Return the negative parts of a task, for evaluation; KeyError for a category outside the lexicon."""
    return frozenset(rule(category, task).negative)


SURE, GENERAL = 0.95, 0.7
"""confidence of a row for the task itself, and of a row for any use"""


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: None) -> PartDescription:
    """Describe an object by its name and category (`Describer`); the views are not used."""
    return look_up(mesh.name, mesh.category, task)


def look_up(name: str, category: str, task: str) -> PartDescription:
    """Describe an object for a task; category 'unknown' and no notes for a category outside the lexicon."""
    kind = known_category(category)
    if not kind:
        return PartDescription(name, "unknown", task, (), "rules")
    row = rule(kind, task)
    verb = parse_task(task).verb
    sure = SURE if verb else GENERAL
    notes = tuple(_note(kind, part, row, sure) for part in PARTS[kind].split())
    return PartDescription(name, kind, task, notes, "rules")


def known_category(category: str) -> str:
    """Return the category in the spelling of the lexicon ("Soldering iron" is soldering_iron), '' for an unknown one."""
    word = re.sub(r"[^a-z]+", "_", category.lower()).strip("_")
    return word if word in LEXICON else ""


def _note(kind: str, part: str, row: Rule, confidence: float) -> PartNote:
    role: Literal["negative", "positive", "neutral"] = "neutral"
    reason = ""
    if part in row.negative:
        role, reason = "negative", row.reason
    elif part in row.positive:
        role, reason = "positive", "a hand belongs here"
    return PartNote(part, part_phrase(kind, part), role, reason, confidence, role_changes(kind, part, role == "negative"))
