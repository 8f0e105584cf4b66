"""Labelled images of hands: labels separate skin, sleeves, sides and held objects, and rendering is deterministic."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.synthetic.human_hand.skin import ARM_M
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.stills import hand_images
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


@pytest.fixture(scope="module", autouse=True)
def few_people() -> Iterator[None]:
    """Two people in a room instead of four."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hand_images, "PEOPLE", 2)
        yield


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> HandLessons:
    """Labelled images of one room."""
    return hand_lessons.run(ROOM, SMALL, Scratch(tmp_path_factory.mktemp("room")))


def test_labels_include_every_class_and_some_images_without_hands(rendered: HandLessons) -> None:
    """Both hands, sleeves and held objects occur; a touched object is touched by a hand of the same image."""
    assert rendered.pictures.shape == (16, 64, 96, 3) and rendered.labels.shape == (16, 64, 96)
    assert {LEFT_HAND, RIGHT_HAND, SLEEVE, TOUCHED} <= set(np.unique(rendered.labels))
    hands = np.isin(rendered.labels, (LEFT_HAND, RIGHT_HAND)).any((1, 2))
    assert hands.any() and not hands.all()


def test_same_room_gives_the_same_bytes(rendered: HandLessons, tmp_path: Path) -> None:
    """Another seed gives other images."""
    few = replace(SMALL, pictures=3)
    again = hand_lessons.run(ROOM, few, Scratch(tmp_path))
    other = hand_lessons.run(replace(ROOM, seed=8), replace(SMALL, pictures=1), Scratch(tmp_path))
    assert np.array_equal(again.pictures, rendered.pictures[:3]) and np.array_equal(again.labels, rendered.labels[:3])
    assert not np.array_equal(other.pictures, again.pictures[:1])


def test_images_have_no_empty_background(rendered: HandLessons) -> None:
    """The background is filled beyond the room, so that rendered images have no black holes."""
    assert (rendered.pictures.max((1, 2, 3)) > 0).all()
    rng = np.random.default_rng(0)
    assert backdrop((96, 64), rng).shape == (64, 96, 3) and backdrop((96, 64), rng).std() > 0


def test_labels_out_of_range_are_refused() -> None:
    """The schema checks the range of the labels."""
    with pytest.raises(SchemaError, match=r"expected 0\.\.4, got 5"):
        HandLessons("x", "train", np.zeros((1, 2, 2, 3), np.uint8), np.full((1, 2, 2), 5, np.uint8))


def test_sleeves_have_all_lengths_and_gloves_are_rare() -> None:
    """Bare arms occur as well, and gloves are rare."""
    looks = [random_sleeves(np.random.default_rng(n)) for n in range(40)]
    cuffs = np.array([look.cuff_m for look in looks])
    assert (cuffs < 0.1).any() and ((cuffs > 0.1) & (cuffs < ARM_M)).any() and (cuffs == ARM_M).any()
    assert sum(look.gloved for look in looks) < 7


@pytest.mark.parametrize("side", SIDES)
def test_free_hands_are_on_their_own_side_above_the_table(side: str) -> None:
    """A free hand may reach slightly across, and its palm frame is orthonormal."""
    palms = [free_hand_pose(side, np.random.default_rng(n))[0] for n in range(50)]
    across = np.array([palm[0, 3] for palm in palms]) * (1 if side == "right" else -1)
    assert (across > -0.15).all() and across.mean() > 0.04 and all(palm[2, 3] > 0 for palm in palms)
    assert all(np.allclose(palm[:3, :3].T @ palm[:3, :3], np.eye(3)) for palm in palms)


def test_hands_apart_rejects_colliding_palms() -> None:
    """A single palm never collides."""
    here, there = np.eye(4), np.eye(4)
    there[0, 3] = 0.05
    assert hands_apart([here]) and not hands_apart([here, there])


def test_cameras_across_the_table_are_rotated() -> None:
    """Other cameras are on the person's own side or above; all look near their target."""
    gaze = np.array([*CENTRE, 0.04])
    views = [sample_camera(gaze, (96, 64), np.random.default_rng(n)) for n in range(60)]
    assert {turned for _, turned in views} == {stand.turned for stand in VIEW_RANGES}
    for camera, turned in views:
        assert (camera.T_world_cam[1, 3] > gaze[1] - 0.2) if turned else (camera.T_world_cam[1, 3] < gaze[1] + 0.25)


def test_skin_and_sleeve_of_an_arm_have_different_entities() -> None:
    """A watch on the wrist belongs to the hand."""
    rng = np.random.default_rng(4)
    one = PersonModel.sample(rng)
    while one.hands["left"].sleeve is None or one.hands["left"].watch is None:
        one = PersonModel.sample(rng)
    arm = hand_images._arm_instances(one, hand_images.HandAction("left", *free_hand_pose("left", rng)))
    assert [part.entity for part in arm] == [hand_images.ENTITY["left"], hand_images.CLOTH, hand_images.ENTITY["left"]]
