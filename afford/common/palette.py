"""Colours of pictures, sheets, plots and recordings: the same thing looks the same in all of them. RGB, 0..255.

The page of the demo has the hands' colours once more, in its style sheet; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence

from blake3 import blake3

from schemas.masks import Entity

TONES = ((216, 174, 152), (206, 158, 132), (190, 142, 114), (162, 116, 90), (122, 86, 66), (90, 63, 49))

Colour = tuple[int, int, int]
Palette = Sequence[Colour]
"""one colour per label or mask"""
LEFT: Colour = (240, 130, 20)
RIGHT: Colour = (40, 130, 240)
"""orange and blue, which those who do not see red and green apart tell apart as well"""
HANDS = {"left": LEFT, "right": RIGHT}
OBJECTS: tuple[Colour, ...] = ((102, 187, 106), (255, 202, 40), (171, 71, 188), (38, 198, 218), (141, 110, 99), (156, 204, 101),
                               (236, 64, 122), (0, 137, 123))  # fmt: skip
"""none of them near a hand's"""
INK: Colour = (25, 28, 32)
PAPER: Colour = (250, 250, 248)
FAINT: Colour = (110, 116, 124)


def web(colour: Colour) -> str:
    """#rrggbb, as matplotlib wants it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def colours_of(entities: Sequence[Entity]) -> Palette:
    """A colour for each entity: hands have their own, an object the one of its name, or the next free one."""
    found: list[Colour] = []
    for entity in entities:
        start = blake3(entity.entity_id.encode()).digest()[0]
        turns = [OBJECTS[(start + n) % len(OBJECTS)] for n in range(len(OBJECTS))]
        found.append(HANDS.get(entity.side) or next((colour for colour in turns if colour not in found), turns[0]))
    return found
