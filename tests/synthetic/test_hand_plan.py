"""Rooms for lessons about hands: no room twice, splits apart, all settings."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stages.synthetic import hand_plan

FEW = hand_plan.Params(rooms=8, val_rooms=2)


def test_every_room_is_another_one() -> None:
    """Names and seeds differ, between the splits too, and every setting is there."""
    rooms = hand_plan.run(FEW)
    assert [room.split for room in rooms] == ["train"] * 8 + ["val"] * 2
    assert len({room.seed for room in rooms}) == len({room.name for room in rooms}) == 10
    assert {room.setting for room in rooms} == {"kitchen", "desk", "workshop"}


def test_more_rooms_leave_the_others_as_they_are() -> None:
    """So that what was rendered of them is found again; another seed changes all."""
    few, more = hand_plan.run(FEW), hand_plan.run(replace(FEW, rooms=12))
    assert set(few) < set(more)
    assert not set(few) & set(hand_plan.run(replace(FEW, seed=FEW.seed + 1)))


@pytest.mark.parametrize("none", [{"rooms": 0}, {"val_rooms": 0}])
def test_a_split_without_rooms_is_refused(none: dict[str, int]) -> None:
    """Training needs both."""
    with pytest.raises(ValueError, match="expected at least one training and one validation room"):
        hand_plan.run(replace(FEW, **none))
