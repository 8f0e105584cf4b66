"""Laws of sides: one side all one's life, never two hands on one side at a time, and where an arm comes in counts."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from afford.extraction.hands.part_tracks import Segment, Track
from afford.extraction.hands.sides import SidePrior, assign_sides, hand_segments

SIZE = (60, 120)
EGO = SidePrior(False, 0.0, 0.0)


def box(x: int) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask[20:40, x : x + 20] = True
    return mask


def track(sampled: Iterable[int], side_score: float, evidence: float, x: int) -> Track:
    return Track({k: Segment(box(x), side_score, evidence) for k in sampled})


def looks_of(tracks: list[Track], left: int, right: int) -> tuple[list[int], list[int]]:
    """Looks at which each side is in sight, in order of evidence."""
    found = assign_sides(tracks, EGO, 10)
    assert (len(found["left"]), len(found["right"])) == (left, right)
    return tuple([k for one in found[side] for k in one.segments] for side in ("left", "right"))  # type: ignore[return-value]  # two


def test_votes_of_all_looks_count() -> None:
    """One look that errs changes nothing."""
    one = track(range(5), 0.5, 9, 0)
    one.segments[2] = Segment(box(0), -0.9, 9)
    assert looks_of([one], 1, 0) == ([0, 1, 2, 3, 4], [])


def test_the_weaker_of_two_equal_sides_gets_the_other() -> None:
    """The track with less evidence gets the other side when two tracks vote for one side."""
    first, lesser = track(range(4), 0.5, 9, 0), track(range(4), 0.4, 5, 60)
    assert looks_of([lesser, first], 1, 1) == ([0, 1, 2, 3], [0, 1, 2, 3])
    assert assign_sides([lesser, first], EGO, 10)["left"] == [first]


def test_a_third_is_a_hand_where_a_side_is_free() -> None:
    """Nowhere while both are taken."""
    left, right = track(range(6), 0.9, 9, 0), track(range(6), -0.9, 9, 60)
    third = track(range(4, 9), 0.5, 5, 90)
    assert looks_of([left, right, third], 2, 1) == ([0, 1, 2, 3, 4, 5, 6, 7, 8], [0, 1, 2, 3, 4, 5])
    assert looks_of([left, right, track(range(6), 0.5, 5, 90)], 1, 1)[0] == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("x", "count"), [(24, 2), (60, 1)])
def test_a_near_segment_belongs_to_the_same_hand(x: int, count: int) -> None:
    """Near segments that are certain of one side are one hand; distant segments are two hands."""
    looks_of([track(range(4), 0.9, 9, 0), track(range(4), 0.9, 5, x)], count, 2 - count)


@pytest.mark.parametrize("facing", [False, True])
def test_side_of_entry(facing: bool) -> None:
    """An arm enters at the lower left of a head camera, or at the upper right for a facing person; the middle is neutral."""
    bearing, mask = SidePrior(facing, 0.0, 1.0), np.zeros(SIZE, bool)
    mask[20:40, 40:60] = True
    assert bearing.enters(mask) == 0
    mask[40:, 10:30] = True
    there = mask[::-1, ::-1] if facing else mask
    assert bearing.enters(there) > 0.5 and bearing.enters(there[:, ::-1]) == pytest.approx(-bearing.enters(there))


def test_certainty_has_priority_over_evidence() -> None:
    """A track that is certain of a side gets it before a track with more evidence for a hand."""
    sure, more, unsure = track(range(4), 0.9, 4, 0), track(range(4), -0.9, 9, 30), track(range(4), -0.6, 7, 60)
    found = assign_sides([unsure, more, sure], EGO, 1)
    assert found["left"] == [sure] and found["right"] == [more]


def test_motion_is_evidence_for_a_hand() -> None:
    """A moving hand has more evidence than the same hand at rest, which still counts as a hand."""
    p, side = np.where(box(30), 0.9, 0.1).astype(np.float32), np.zeros(SIZE, np.float32)
    rests, moves = (hand_segments(p, side, side, np.full(SIZE, speed, np.float32), 10, 0.2, EGO)[0] for speed in (0, 3))
    assert moves.evidence > 4 * rests.evidence > 0 and np.array_equal(moves.mask, rests.mask)
