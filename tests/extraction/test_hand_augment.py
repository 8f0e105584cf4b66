"""Disguises of lessons: pictures change, hands keep their pixels, the mirror swaps sides, and the draw decides everything."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from afford.extraction.hands.augment import Augmentation, augment, camera_effects, colour_jitter, composite, random_crop, swap_sides
from afford.extraction.hands.backgrounds import Backgrounds
from schemas.scene import LEFT_HAND, REST, RIGHT_HAND
from tests.helpers.made_finder import made_up

LESSONS = made_up("P71_01", "train")
BARE, SHOWN = (LESSONS.pictures[0], LESSONS.labels[0]), (LESSONS.pictures[1], LESSONS.labels[1])
ROOM = Backgrounds((BARE,), ())
SIZE = (48, 80)
STILL = Augmentation(turn_deg=0, share=(0.9999, 1.0), stretch=0, centred=0, elsewhere=0, surfaces=0, lookalikes=0, faces=0,
                     retoned=0, gloved=0, covered=0, soft=0, packed=0, smeared=0)  # fmt: skip


def test_augmentation_is_seeded() -> None:
    """Augmentation depends on its random generator only, and has the requested size."""
    one, same, other = (augment(SHOWN, ROOM, SIZE, np.random.default_rng(seed), Augmentation(surfaces=0)) for seed in (1, 1, 2))
    assert np.array_equal(one[0], same[0]) and np.array_equal(one[1], same[1]) and not np.array_equal(one[0], other[0])
    assert one[0].shape == (*SIZE, 3) and one[0].dtype == np.uint8 and one[1].shape == SIZE and one[1].dtype == np.uint8


def test_a_mirror_swaps_sides_and_twice_is_the_identity() -> None:
    """Labels apart from hands stay."""
    labels = SHOWN[1]
    assert np.array_equal(swap_sides(swap_sides(labels)), labels)
    assert np.array_equal(swap_sides(labels) == LEFT_HAND, labels == RIGHT_HAND)
    assert np.array_equal(swap_sides(labels) > RIGHT_HAND, labels > RIGHT_HAND)


def test_the_left_hand_stays_at_the_left() -> None:
    """Mirrored or not: in these lessons the person's left hand is at the left, and must be afterwards."""
    for seed in range(12):
        _, labels, inside = random_crop(SHOWN, SIZE, np.random.default_rng(seed), STILL)
        left, right = (np.nonzero(labels == side)[1].mean() for side in (LEFT_HAND, RIGHT_HAND))
        assert left < right and inside.mean() > 0.95


def test_other_surroundings_leave_the_arm_and_change_the_rest() -> None:
    """Cut out of a flat picture and put before a bright one."""
    bright = Backgrounds(((np.full_like(BARE[0], 250), BARE[1]),), ())
    rng = np.random.default_rng(3)
    rgb, labels = composite(SHOWN, bright, SIZE, rng, replace(STILL, elsewhere=1.0))
    own, kept = composite(SHOWN, bright, SIZE, np.random.default_rng(3), STILL)
    assert np.array_equal(labels, kept)
    assert rgb[labels == REST].mean() > 240 > 100 > own[labels == REST].mean()
    inner = cv2.erode((labels == LEFT_HAND).astype(np.uint8), np.ones((3, 3))) > 0
    assert inner.any() and np.abs(rgb[inner].astype(int) - own[inner]).max() <= 1


def test_things_in_front_are_no_hand() -> None:
    """Labels only ever turn to rest under them."""
    rng = np.random.default_rng(5)
    _, covered = composite(SHOWN, ROOM, SIZE, rng, replace(STILL, covered=1.0))
    _, plain = composite(SHOWN, ROOM, SIZE, np.random.default_rng(5), STILL)
    assert ((covered == plain) | (covered == REST)).all()


@pytest.mark.parametrize("seed", range(5))
def test_light_and_lens_keep_the_form(seed: int) -> None:
    """Shape and type; a grey picture stays one of few colours, and values stay in range."""
    rng = np.random.default_rng(seed)
    for changed in (colour_jitter(SHOWN[0], rng), camera_effects(SHOWN[0], rng, Augmentation(soft=1.0, packed=1.0, smeared=1.0))):
        assert changed.shape == SHOWN[0].shape and changed.dtype == np.uint8 and not np.array_equal(changed, SHOWN[0])


def test_a_crop_larger_than_its_picture_keeps_arms_at_the_border() -> None:
    """Hands become smaller, and arms that leave the picture below still leave the crop below."""
    far = replace(STILL, share=(1.9999, 2.0))
    near, small = (random_crop(SHOWN, SIZE, np.random.default_rng(2), d)[1] for d in (STILL, far))
    hands = [np.isin(labels, (LEFT_HAND, RIGHT_HAND)).sum() for labels in (near, small)]
    assert 0.15 * hands[0] < hands[1] < 0.35 * hands[0]
    assert (small[-1] != REST).any()


@pytest.mark.parametrize("change", [{"retoned": 1.0}, {"gloved": 1.0}])
def test_another_skin_changes_hands_only(change: dict[str, float]) -> None:
    """Pixels away from hands are the same."""
    plain, labels = composite(SHOWN, ROOM, SIZE, np.random.default_rng(4), STILL)
    other, _ = composite(SHOWN, ROOM, SIZE, np.random.default_rng(4), replace(STILL, **change))
    hand = np.isin(labels, (LEFT_HAND, RIGHT_HAND))
    away = cv2.dilate(hand.astype(np.uint8), np.ones((5, 5))) == 0
    assert np.array_equal(plain[away], other[away]) and not np.array_equal(plain[hand], other[hand])


def test_a_face_is_drawn_behind_hands() -> None:
    """Labels stay, hands keep their pixels, and something else changes."""
    plain, labels = composite(SHOWN, ROOM, SIZE, np.random.default_rng(9), STILL)
    drawn, same = composite(SHOWN, ROOM, SIZE, np.random.default_rng(9), replace(STILL, faces=1.0))
    inner = cv2.erode((labels != REST).astype(np.uint8), np.ones((3, 3))) > 0
    assert np.array_equal(labels, same) and np.array_equal(plain[inner], drawn[inner]) and not np.array_equal(plain, drawn)
