"""Lessons about hands: labels tell skin from sleeve, left from right, held from not; the same room gives the same bytes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from afford.synthetic.human_hand.skin import ARM_M
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.stills import hand_images as drawn
from afford.synthetic.stills.hand_scenes import (
    VIEW_RANGES,
    PersonModel,
    backdrop,
    free_hand_pose,
    hands_apart,
    random_sleeves,
    sample_camera,
)
from schemas.scene import LEFT_HAND, RIGHT_HAND, SLEEVE, TOUCHED, HandLessons, HandRoom
from schemas.spec import SchemaError
from schemas.video import SIDES
from stages.synthetic import hand_lessons
from tests.helpers.made_samples import Scratch

ROOM = HandRoom("P71_99", "desk", 7, "train")
SMALL = hand_lessons.Params(pictures=16, width_px=96, height_px=64, supersample=1)


@cache
def lessons(folder: Path) -> HandLessons:
    """Rendered once for all tests."""
    return hand_lessons.run(ROOM, SMALL, Scratch(folder))


@pytest.fixture
def rendered(tmp_path_factory: pytest.TempPathFactory) -> HandLessons:
    return lessons(Path(tmp_path_factory.getbasetemp()))


def test_every_label_comes_up_and_some_pictures_show_no_hand(rendered: HandLessons) -> None:
    """Both hands, sleeves, held things; what is touched is touched by a hand of the same picture."""
    assert rendered.pictures.shape == (16, 64, 96, 3) and rendered.labels.shape == (16, 64, 96)
    assert {LEFT_HAND, RIGHT_HAND, SLEEVE, TOUCHED} <= set(np.unique(rendered.labels))
    hands = np.isin(rendered.labels, (LEFT_HAND, RIGHT_HAND)).any((1, 2))
    assert hands.any() and not hands.all()


def test_the_same_room_gives_the_same_bytes(rendered: HandLessons, tmp_path: Path) -> None:
    """Another seed does not."""
    few = replace(SMALL, pictures=3)
    again = hand_lessons.run(ROOM, few, Scratch(tmp_path))
    other = hand_lessons.run(replace(ROOM, seed=8), few, Scratch(tmp_path))
    assert np.array_equal(again.pictures, rendered.pictures[:3]) and np.array_equal(again.labels, rendered.labels[:3])
    assert not np.array_equal(other.pictures, again.pictures)


def test_a_picture_is_never_empty(rendered: HandLessons) -> None:
    """Where a room ends, something else begins: black holes would tell rendered pictures from others."""
    assert (rendered.pictures.max((1, 2, 3)) > 0).all()
    rng = np.random.default_rng(0)
    assert backdrop((96, 64), rng).shape == (64, 96, 3) and backdrop((96, 64), rng).std() > 0


def test_labels_beyond_those_that_are_known_are_refused() -> None:
    """The noun checks itself."""
    with pytest.raises(SchemaError, match=r"expected 0\.\.4, got 5"):
        HandLessons("x", "train", np.zeros((1, 2, 2, 3), np.uint8), np.full((1, 2, 2), 5, np.uint8))


def test_sleeves_are_of_all_lengths() -> None:
    """Also none, and hardly anybody wears gloves."""
    looks = [random_sleeves(np.random.default_rng(n)) for n in range(60)]
    cuffs = np.array([look.cuff_m for look in looks])
    assert (cuffs < 0.1).any() and ((cuffs > 0.1) & (cuffs < ARM_M)).any() and (cuffs == ARM_M).any()
    assert sum(look.gloved for look in looks) < 10


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_in_the_air_is_on_its_own_side_and_above_the_table(side: str) -> None:
    """Mostly; it may reach a little across. Its palm is a pose."""
    palms = [free_hand_pose(side, np.random.default_rng(n))[0] for n in range(50)]
    across = np.array([palm[0, 3] for palm in palms]) * (1 if side == "right" else -1)
    assert (across > -0.15).all() and across.mean() > 0.04 and all(palm[2, 3] > 0 for palm in palms)
    assert all(np.allclose(palm[:3, :3].T @ palm[:3, :3], np.eye(3)) for palm in palms)


def test_hands_do_not_run_into_each_other() -> None:
    """One palm alone never does."""
    here, there = np.eye(4), np.eye(4)
    there[0, 3] = 0.05
    assert hands_apart([here]) and not hands_apart([here, there])


def test_cameras_across_the_table_are_turned() -> None:
    """The others are on the person's own side or above; all look at what they are told to look at."""
    gaze = np.array([*CENTRE, 0.04])
    views = [sample_camera(gaze, (96, 64), np.random.default_rng(n)) for n in range(60)]
    assert {turned for _, turned in views} == {stand.turned for stand in VIEW_RANGES}
    for camera, turned in views:
        assert (camera.T_world_cam[1, 3] > gaze[1] - 0.2) if turned else (camera.T_world_cam[1, 3] < gaze[1] + 0.25)


def test_skin_and_cloth_of_an_arm_are_told_apart() -> None:
    """What is worn on the wrist belongs to the hand."""
    rng = np.random.default_rng(4)
    one = PersonModel.sample(rng)
    while one.hands["left"].sleeve is None or one.hands["left"].watch is None:
        one = PersonModel.sample(rng)
    drawn_arm = drawn._arm_instances(one, drawn.HandAction("left", *free_hand_pose("left", rng)))
    assert [part.entity for part in drawn_arm] == [drawn.ENTITY["left"], drawn.CLOTH, drawn.ENTITY["left"]]
