"""Names of masks: the side of a hand in the usual spellings, ambiguous names, and remarks on names and sizes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from afford.common.errors import SourceError
from afford.extraction.sources.remarks import quoted_list
from afford.extraction.sources.rows import AnnotatedImage, Note, RawAnnotation
from schemas.video import Hand

SIDE: dict[str, Hand] = {"left": "left", "l": "left", "right": "right", "r": "right", "rigth": "right"}
"""'rigth' is in 13 images of VISOR"""
JOINED: dict[str, Hand] = {
    "lefthand": "left", "handleft": "left", "lhand": "left", "handl": "left", "lh": "left",
    "righthand": "right", "handright": "right", "rhand": "right", "handr": "right", "rh": "right"}  # fmt: skip
OWNER = {"the", "my", "own", "a", "human", "person", "s", "wearer", "user"}
"""words that do not change the meaning of a name"""
HANDS = {"hand", "hands"}
VAGUE = {*HANDS, *SIDE, "both", "two", "one", "other", "another", "first", "second", "unknown", "any", "either"}


def side_of(name: str) -> Hand | None:
    """Parse the side of a hand: 'left hand', 'hand_left', 'LeftHand', 'Hand (L)', 'l hand', 'lh'; None for any other name."""
    words = _words(name)
    sides = [SIDE[word] for word in words if word in SIDE]
    if len(words) == 2 and len(sides) == 1 and "hand" in words:
        return sides[0]
    return JOINED.get("".join(words)) if len(words) <= 2 else None


def is_vague(name: str) -> bool:
    """Test for a name of a hand without a side: 'hand', 'Hand 2', 'both hands', 'left'."""
    words = _words(name)
    if side_of(name) or not words:
        return False
    about_hands = bool(HANDS & set(words)) or set(words) <= {"left", "right"}
    return about_hands and all(word in VAGUE or word.isdigit() or len(word) == 1 for word in words)


def check_names(images: Sequence[AnnotatedImage], name: str, notes: list[Note]) -> None:
    """Check the names of masks: SourceError for hands without a side, remarks on names that resemble hands, and on loose gloves."""
    rows = [row for annotated in images for row in annotated.rows]
    vague = sorted({row.name for row in rows if is_vague(row.name)})
    if vague:
        raise SourceError(f"{name}, names of masks", "each hand called 'left hand' or 'right hand'", quoted_list(vague),
                          "rename them by the person's own side (hand_left, LeftHand or 'L hand' will do), or remove them")
    nearly = sorted({row.name for row in rows if _resembles_hand(row)})
    if nearly:
        notes.append((0, f"{name}: {quoted_list(nearly)} counts as an object; a hand is called 'left hand' or 'right hand', and a "
                         "glove has 'on_which_hand'"))


def _resembles_hand(row: RawAnnotation) -> bool:
    words = set(_words(row.name))
    glove = bool({"glove", "gloves"} & words) and not any(map(side_of, row.worn))
    return side_of(row.name) is None and (glove or ("hand" in words and bool({"left", "right"} & words)))


def _words(name: str) -> list[str]:
    """Split a name into lower-case words and numbers, also at CamelCase; words for the owner of the hand are dropped."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word for word in re.findall(r"[^\W\d_]+|\d+", spaced.lower()) if word not in OWNER]
