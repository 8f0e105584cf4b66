"""Plan of the rooms for labelled images of hands: distinct rooms, disjoint splits, all settings."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stages.synthetic import hand_plan

FEW = hand_plan.Params(rooms=8, val_rooms=2)


def test_rooms_have_distinct_names_and_seeds() -> None:
    """Names and seeds differ, also between the splits, and every setting occurs."""
    rooms = hand_plan.run(FEW)
    assert [room.split for room in rooms] == ["train"] * 8 + ["val"] * 2
    assert len({room.seed for room in rooms}) == len({room.name for room in rooms}) == 10
    assert {room.setting for room in rooms} == {"kitchen", "desk", "workshop"}


def test_additional_rooms_leave_the_others_unchanged() -> None:
    """Rendered rooms stay cached when more are planned; another seed changes all rooms."""
    few, more = hand_plan.run(FEW), hand_plan.run(replace(FEW, rooms=12))
    assert set(few) < set(more)
    assert not set(few) & set(hand_plan.run(replace(FEW, seed=FEW.seed + 1)))


@pytest.mark.parametrize("none", [{"rooms": 0}, {"val_rooms": 0}])
def test_split_without_rooms_is_refused(none: dict[str, int]) -> None:
    """Training needs both splits."""
    with pytest.raises(ValueError, match="expected at least one training and one validation room"):
        hand_plan.run(replace(FEW, **none))
