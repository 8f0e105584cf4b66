"""One meaning of each colour, wherever it is written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from afford.common.palette import HANDS, OBJECTS, colours_of, web
from afford.extraction.quality_report import paint
from schemas.masks import Entity
from schemas.video import SIDES

AFFORD = Path(__file__).resolve().parents[2] / "afford"


def test_the_page_has_the_colours_of_the_sheets() -> None:
    """Its style sheet names both, and its script takes them from there."""
    found = re.findall(r"--(left|right): rgb\((\d+) (\d+) (\d+)\);", (AFFORD / "twohands" / "demo" / "page.css").read_text())
    assert {side: tuple(map(int, rgb)) for side, *rgb in found} == HANDS and len(found) == 2
    script = (AFFORD / "twohands" / "demo" / "page.js").read_text()
    assert not [side for side, colour in HANDS.items() if re.search(r",\s*".join(map(str, colour)), script)]


def test_colours_of_hands_are_defined_once() -> None:
    """No other module of afford has either of them, as numbers or as #rrggbb."""
    written = re.compile("|".join(rf"{r}, ?{g}, ?{b}\b|{web((r, g, b))}" for r, g, b in HANDS.values()), re.IGNORECASE)
    assert [path.name for path in AFFORD.rglob("*.py") if written.search(path.read_text())] == ["palette.py"]


def test_no_object_looks_like_a_hand() -> None:
    """Colours of objects differ from each other and are far from both hands'; hands are in the order of all arrays."""
    assert tuple(HANDS) == SIDES and len(set(OBJECTS)) == len(OBJECTS)
    apart = np.linalg.norm(np.array(OBJECTS)[:, None] - np.array(list(HANDS.values())), axis=2)
    assert apart.min() > 60


def test_hand_colour_depends_on_the_side_alone() -> None:
    """The order of the entities has no influence; an object keeps its colour in another list."""
    hands = {side: Entity(f"{side} hand", f"{side} hand", -1, "hand", side) for side in SIDES}
    mug, pan = (Entity(name, name, -1, "object", "") for name in ("mug", "pan"))
    for listed in ((hands["right"],), (mug, hands["right"]), (hands["right"], pan, hands["left"], mug)):
        found = dict(zip((entity.entity_id for entity in listed), colours_of(listed), strict=True))
        assert all(found[f"{side} hand"] == HANDS[side] for side in SIDES if f"{side} hand" in found)
        assert found.get("mug", colours_of([mug])[0]) == colours_of([mug])[0]


def test_masks_are_painted_in_the_order_of_their_colours() -> None:
    """The region of a right hand alone is blue in the report's sheet; pixels outside all masks are unchanged."""
    grey, region = np.full((20, 30, 3), 100, np.uint8), np.zeros((1, 20, 30), bool)
    region[0, 5:15, 5:15] = True
    drawn = paint(grey, region, [HANDS["right"]]).astype(int)
    assert np.array_equal(drawn[~region[0]], grey[~region[0]]) and drawn[10, 10, 2] > drawn[10, 10, 1] > drawn[10, 10, 0]
