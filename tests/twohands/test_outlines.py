"""Outlines of photographs: polygons inside their pictures, crops that hold a way to act, cases that the benchmark reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from afford.common.image_files import encode_jpeg
from afford.dataset.act_affordance import cases, read_tree
from afford.twohands.benchmark.cases import read
from benchmarks.shipped import outlined
from runner.canonical import file_digest

OUTLINES = json.loads(outlined.OUTLINES.read_text())


def test_outlines_are_inside_their_objects() -> None:
    """Boxes are ordered and inside the picture; every region has pixels, and some way lies in the box of the object."""
    for case in OUTLINES:
        x0, y0, x1, y1 = case["object"]
        assert 0 <= x0 < x1 <= 10 and 0 <= y0 < y1 <= 10, case["task"]
        ways = outlined.ways_of(case, 300, 400)
        assert all(mask.any() for way in ways for mask in way.values())
        box = outlined.cropped(outlined.pixels(case["object"], 300, 400), 300, 400)
        shares = [min(mask[box].sum() / mask.sum() for mask in way.values()) for way in ways]
        assert max(shares) > outlined.SEEN, case["task"]


def test_one_hand_may_be_either() -> None:
    """A region of one hand is two ways; regions of both are one."""
    square = [[[1, 1], [5, 1], [5, 5], [1, 5]]]
    either = outlined.ways_of({"ways": [{"one": square}]}, 100, 100)
    assert [list(way) for way in either] == [["right"], ["left"]] and np.array_equal(either[0]["right"], either[1]["left"])
    (both,) = outlined.ways_of({"ways": [{"left": square, "right": square}]}, 100, 100)
    assert set(both) == {"left", "right"} and both["left"].sum() == pytest.approx(1600, rel=0.1)


def test_cases_are_read_by_the_benchmark(tmp_path: Path) -> None:
    """Every question is a crop and a whole picture in ActAffordance's layout, with all its ways where they are in view."""
    (tmp_path / "photographs" / "scene").mkdir(parents=True)
    blank = encode_jpeg(np.zeros((300, 400, 3), np.uint8), 80).tobytes()
    for name in {case["photo"] for case in OUTLINES}:
        (tmp_path / "photographs" / "scene" / f"{name}.jpg").write_bytes(blank)
    outlined.write_cases(tmp_path / "photographs", tmp_path / "cases")
    found = [read(one) for one in cases(read_tree(tmp_path / "cases", file_digest))]
    assert len(found) == 2 * len(OUTLINES)
    whole = [case for case in found if case.protocol == "masks"]
    assert {case.task for case in whole} == {case["task"] for case in OUTLINES}
