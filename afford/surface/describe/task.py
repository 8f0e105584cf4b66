"""A task in words -> what is done, and whether the thing is hot or cold. Small on purpose: a table and one rule, no grammar."""

from __future__ import annotations

import re
from dataclasses import dataclass

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
"""What is done -> the words that say so, at the start of a task. The longest that fits is taken."""
HOT = ("hot", "boiling", "steaming", "heated", "glowing", "burning", "lit")
COLD = ("cold", "cool", "cooled", "iced", "unplugged", "unheated")
STATES = {**dict.fromkeys(HOT, "hot"), **dict.fromkeys(COLD, "cold")}


@dataclass(frozen=True)
class ParsedTask:
    """`verb` is a key of VERBS, '' where no verb is known; `state` is hot, cold or '' where the words do not say."""

    verb: str
    state: str


def parse_task(text: str) -> ParsedTask:
    """What a task says. The last word of state counts ("pour the hot tea from the cold kettle" is about the kettle)."""
    words = re.findall(r"[a-z]+(?:-[a-z]+)?", text.lower())
    said = " ".join(words)
    fits = [(len(phrase), verb) for verb, phrases in VERBS.items() for phrase in phrases if f"{said} ".startswith(f"{phrase} ")]
    states = [STATES[word] for word in words if word in STATES]
    return ParsedTask(max(fits)[1] if fits else "", states[-1] if states else "")
