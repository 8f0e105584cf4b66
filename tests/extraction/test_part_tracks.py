"""Laws of following: what overlaps is the same; hands also leap, and part again after they met."""

from __future__ import annotations

import numpy as np
import pytest

from afford.extraction.hands.motion import SampledFrames
from afford.extraction.hands.part_tracks import Segment, link_segments

SIZE = (60, 120)


def box(x: int, width: int = 20) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask[20:40, x : x + width] = True
    return mask


def still(count: int) -> SampledFrames:
    """Looks between which nothing is seen to move."""
    flow = np.zeros((SIZE[0] // 2, SIZE[1] // 2, 2), np.float32)
    rgb = np.zeros((count, *SIZE, 3), np.uint8)
    return SampledFrames(np.arange(count), rgb, np.arange(count) / 10, [None, *[flow] * (count - 1)], [*[flow] * (count - 1), None])


def tracks(*masks: list[np.ndarray], leap_px: float) -> list[dict[int, np.ndarray]]:
    found = [[Segment(mask, 0.5, 10.0) for mask in look] for look in masks]
    made = link_segments(found, still(len(masks)), 0.2, 0, leap_px=leap_px)
    return [{k: segment.mask for k, segment in track.segments.items()} for track in made]


@pytest.mark.parametrize(("x", "width", "leap_px", "count"), [(8, 20, 0, 1), (30, 20, 40, 1), (30, 20, 0, 2), (30, 20, 20, 2),
                                                              (30, 2, 40, 2)])  # fmt: skip
def test_leap_limits_the_distance_of_a_match(x: int, width: int, leap_px: float, count: int) -> None:
    """Overlapping segments match in any case; distant ones of similar size match within `leap_px` only."""
    assert len(tracks([box(0)], [box(x, width)], leap_px=leap_px)) == count


def test_overlap_has_priority_over_distance() -> None:
    """An overlapping segment is matched before a near one."""
    found = tracks([box(0), box(40)], [box(25), box(4)], leap_px=60)
    assert [track[1][30].argmax() for track in found] == [4, 25]


def test_two_that_meet_are_two_as_before() -> None:
    """Each has the share of the common part that is nearer to it, together they are the whole of it; they part as who they were."""
    apart, met = [box(10), box(50)], [box(15, 50)]
    one, other = tracks(apart, met, apart, leap_px=10)
    assert np.array_equal(one[1] | other[1], met[0]) and not (one[1] & other[1]).any()
    assert one[1][30].argmax() == 15 and abs(int(one[1].sum()) - int(other[1].sum())) <= 40
    assert np.array_equal(one[2], apart[0]) and np.array_equal(other[2], apart[1])
    assert all(not np.array_equal(track[1], one[1]) for track in tracks(apart, met, leap_px=0) if 1 in track)


def test_a_small_track_does_not_split_a_large_segment() -> None:
    """A small track inside a segment is a part of it."""
    found = tracks([box(10, 40), box(54, 4)], [box(10, 50)], leap_px=10)
    assert np.array_equal(found[0][1], box(10, 50))
