"""One meaning of each colour, wherever it is written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from afford.palette import HANDS, OBJECTS, web
from schemas.hands import SIDES

AFFORD = Path(__file__).resolve().parent.parent / "afford"


def test_the_page_has_the_colours_of_the_sheets() -> None:
    """Its style sheet names both, and its script takes them from there."""
    found = re.findall(r"--(left|right): rgb\((\d+) (\d+) (\d+)\);", (AFFORD / "demo" / "page.css").read_text())
    assert {side: tuple(map(int, rgb)) for side, *rgb in found} == HANDS and len(found) == 2
    script = (AFFORD / "demo" / "page.js").read_text()
    assert not [side for side, colour in HANDS.items() if re.search(r",\s*".join(map(str, colour)), script)]


def test_nobody_else_writes_a_hands_colour() -> None:
    """No other module of afford has either of them, as numbers or as #rrggbb."""
    written = re.compile("|".join(rf"{r}, ?{g}, ?{b}\b|{web((r, g, b))}" for r, g, b in HANDS.values()), re.IGNORECASE)
    assert [path.name for path in AFFORD.rglob("*.py") if written.search(path.read_text())] == ["palette.py"]


def test_no_object_looks_like_a_hand() -> None:
    """Colours of objects differ from each other and are far from both hands'; hands are in the order of all arrays."""
    assert tuple(HANDS) == SIDES and len(set(OBJECTS)) == len(OBJECTS)
    apart = np.linalg.norm(np.array(OBJECTS)[:, None] - np.array(list(HANDS.values())), axis=2)
    assert apart.min() > 60
