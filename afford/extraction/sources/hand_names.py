"""Names of hands in the usual spellings -> the side; names that may be a hand of either side."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence

from afford.common.errors import SourceError
from afford.extraction.sources.rows import Note, Row, Sheet
from schemas.video import Hand

SIDE: dict[str, Hand] = {"left": "left", "l": "left", "right": "right", "r": "right", "rigth": "right"}
"""'rigth' is in 13 images of VISOR"""
JOINED: dict[str, Hand] = {
    "lefthand": "left", "handleft": "left", "lhand": "left", "handl": "left", "lh": "left",
    "righthand": "right", "handright": "right", "rhand": "right", "handr": "right", "rh": "right"}  # fmt: skip
OWNER = {"the", "my", "own", "a", "human", "person", "s", "wearer", "user"}
"""words beside a hand that do not make it another one"""
HANDS = {"hand", "hands"}
VAGUE = {*HANDS, *SIDE, "both", "two", "one", "other", "another", "first", "second", "unknown", "any", "either"}


def side_of(name: str) -> Hand | None:
    """Side of a hand called `name`: 'left hand', 'hand_left', 'LeftHand', 'Hand (L)', 'l hand', 'lh'; None for any other name."""
    words = _words(name)
    sides = [SIDE[word] for word in words if word in SIDE]
    if len(words) == 2 and len(sides) == 1 and "hand" in words:
        return sides[0]
    return JOINED.get("".join(words)) if len(words) <= 2 else None


def is_vague(name: str) -> bool:
    """Whether a name may be a hand, but not of which side: 'hand', 'Hand 2', 'both hands', 'left'."""
    words = _words(name)
    if side_of(name) or not words:
        return False
    about_hands = bool(HANDS & set(words)) or set(words) <= {"left", "right"}
    return about_hands and all(word in VAGUE or word.isdigit() or len(word) == 1 for word in words)


def check_names(sheets: Sequence[Sheet], name: str, notes: list[Note]) -> None:
    """SourceError when masks of the file called `name` may be hands of either side; a remark on names that nearly are those of a
    hand, and on gloves of no hand.
    """
    rows = [row for sheet in sheets for row in sheet.rows]
    vague = sorted({row.name for row in rows if is_vague(row.name)})
    if vague:
        raise SourceError(f"{name}, names of masks", "each hand called 'left hand' or 'right hand'", listed(vague),
                          "rename them by the person's own side (hand_left, LeftHand or 'L hand' will do), or remove them")
    nearly = sorted({row.name for row in rows if _nearly(row)})
    if nearly:
        notes.append((0, f"{name}: {listed(nearly)} counts as an object; a hand is called 'left hand' or 'right hand', and a "
                         "glove has 'on_which_hand'"))


def _nearly(row: Row) -> bool:
    words = set(_words(row.name))
    glove = bool({"glove", "gloves"} & words) and not any(map(side_of, row.worn))
    return side_of(row.name) is None and (glove or ("hand" in words and bool({"left", "right"} & words)))


def _words(name: str) -> list[str]:
    """Words and numbers of a name in lower case, split where CamelCase does; who owns the hand is left out."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word for word in re.findall(r"[^\W\d_]+|\d+", spaced.lower()) if word not in OWNER]


ALIKE = 1.03
"""sides of pictures whose proportions differ by less are only rounded"""
Size = tuple[int, int]
"""width and height, px"""
SHOWN = 5
"""names that a sentence lists"""


def other_shape(grids: Iterable[Size], size_wh: Size) -> str:
    """A remark on key frames of other proportions than the pictures, `size_wh`; '' when there is none. Masks of such a frame are
    stretched to the picture.
    """
    found = [grid for grid in grids if not 1 / ALIKE <= grid[0] / grid[1] * size_wh[1] / size_wh[0] <= ALIKE]
    if not found:
        return ""
    return (f"masks of {len(found)} key frames refer to a size of another shape than the pictures, {found[0][0]}x{found[0][1]} "
            f"against {size_wh[0]}x{size_wh[1]}, and are stretched; correct 'width' and 'height' of the images if they are wrong")


def handless(masks: Iterable[tuple[str, str]]) -> str:
    """Remark on the (side, name) of the masks of a clip, none of which is a hand; '' where one is, or there are no masks."""
    found = list(masks)
    if not found or any(side for side, _ in found):
        return ""
    names = [name for name, _ in Counter(name for _, name in found).most_common()]
    return ("no mask is called 'left hand' or 'right hand', so there is no contact and no sample; names are "
            f"{listed(names)}")


def listed(names: Iterable[str]) -> str:
    """The first few names, quoted."""
    found = [repr(name) for name in names]
    return ", ".join(found[:SHOWN]) + (f" and {len(found) - SHOWN} more" if len(found) > SHOWN else "")
