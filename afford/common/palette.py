"""Colours of images, sheets, plots and recordings, RGB 0..255: one entity has one colour everywhere.

The style sheet of the demo page repeats the colours of the hands; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence

from blake3 import blake3

from schemas.masks import Entity

TONES = ((216, 174, 152), (206, 158, 132), (190, 142, 114), (162, 116, 90), (122, 86, 66), (90, 63, 49))

Colour = tuple[int, int, int]
Palette = Sequence[Colour]
"""one colour for each label or mask"""
LEFT: Colour = (240, 130, 20)
RIGHT: Colour = (40, 130, 240)
"""orange and blue, which remain distinct with red-green colour blindness"""
HANDS = {"left": LEFT, "right": RIGHT}
OBJECTS: tuple[Colour, ...] = ((102, 187, 106), (255, 202, 40), (171, 71, 188), (38, 198, 218), (141, 110, 99), (156, 204, 101),
                               (236, 64, 122), (0, 137, 123))  # fmt: skip
"""colours far from those of the hands"""
INK: Colour = (25, 28, 32)
PAPER: Colour = (250, 250, 248)
FAINT: Colour = (110, 116, 124)


def web(colour: Colour) -> str:
    """Format a colour as #rrggbb, as matplotlib and CSS expect."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def colours_of(entities: Sequence[Entity]) -> Palette:
    """Choose a colour for each entity: fixed ones for hands, one derived from its name for an object."""
    found: list[Colour] = []
    for entity in entities:
        start = blake3(entity.entity_id.encode()).digest()[0]
        turns = [OBJECTS[(start + n) % len(OBJECTS)] for n in range(len(OBJECTS))]
        found.append(HANDS.get(entity.side) or next((colour for colour in turns if colour not in found), turns[0]))
    return found
