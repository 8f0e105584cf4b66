"""Laws of touched objects: what moves with a hand is one, what stands still or is a sleeve is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from afford.common.masks import iou
from afford.extraction.hands.forearm import forearms
from afford.extraction.hands.grip import HandKeypoints, finger_contact, grip_ring
from afford.extraction.hands.held_objects import NOTHING, ContactModel, TouchedObjects, touched_objects
from afford.extraction.hands.motion import SampledFrames, sample_frames
from afford.extraction.hands.moving_objects import fill_holes
from afford.extraction.hands.object_evidence import EvidenceModel
from afford.extraction.hands.still_background import StillBackground
from afford.extraction.hands.touch_paths import PathModel
from schemas.video import Frames

HEIGHT, WIDTH, COUNT = 128, 224, 24
PATH = PathModel(touch=0.0, same=2.0, change=1.0, unsure=-1.0)
MODEL = ContactModel(4, 60.0, 0.2, 15, 3, PATH, 0.5)
SKIN, CARD, CLOTH = (224, 172, 140), (40, 60, 170), (40, 110, 60)


@dataclass
class Made:
    """Sampled frames of a hand and a card, and where they truly are."""

    sampled: SampledFrames
    hand: np.ndarray
    """(k, h, w) bool"""
    card: np.ndarray
    sleeve: np.ndarray


def noise(seed: int, height: int, width: int) -> np.ndarray:
    """Texture (h, w, 3) uint8 with structure at the scale of a few pixels."""
    rough = np.random.default_rng(seed).uniform(60, 250, (height // 4, width // 4, 3)).astype(np.float32)
    return cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def made(held: bool = True, pan_px: float = 0.0, sleeve: bool = False, card: bool = True) -> Made:
    """A hand comes from below to a card, moves with it to the right if `held`, or without it, and stays there."""
    scene, y, x = noise(1, HEIGHT + 80, WIDTH + 160), *np.mgrid[:HEIGHT, :WIDTH]
    worn, print_ = noise(2, HEIGHT, WIDTH) // 5, noise(3, HEIGHT, WIDTH) // 3
    rgb, masks = [], []
    for k in range(COUNT):
        off = np.array([round(pan_px * k), 0])
        reach, travel = np.clip(k / 6, 0, 1), np.clip((k - 8) / 10, 0, 1) * 90
        at = np.array([60 + travel, 64 + 50 * (1 - reach)]) - off
        there = np.array([60 + (travel if held else 0), 50]) - off
        hand = (abs(x - at[0]) < 9) & (abs(y - at[1]) < 10)
        arm = (abs(x - at[0]) < 9) & (y >= at[1] + 10)
        thing = (abs(x - there[0]) < 20) & (abs(y - there[1]) < 14) & ~hand & ~arm & card
        picture = scene[40 : 40 + HEIGHT, 40 + off[0] : 40 + off[0] + WIDTH].copy()
        for mask, colour, texture in ((thing, CARD, print_), (arm, CLOTH if sleeve else SKIN, worn), (hand, SKIN, worn)):
            picture[mask] = np.clip(np.array(colour) + texture[mask], 0, 255)
        rgb.append(picture)
        masks.append((hand if sleeve else hand | arm, thing, arm & sleeve))
    stamps = np.arange(COUNT) * 100_000_000
    frames = Frames("made", np.arange(1, COUNT + 1), stamps, np.stack(rgb))
    return Made(sample_frames(frames, 0.1), *(np.stack(one) for one in zip(*masks, strict=True)))


def found_in(clip: Made, **more: Any) -> TouchedObjects:
    evidence = EvidenceModel(5.0, 3.0, 8.0, 0.9, 0.45 * WIDTH, False)
    hands = {"left": {}, "right": {k: mask for k, mask in enumerate(clip.hand) if mask.sum() > 50}}
    return touched_objects(clip.sampled, hands, {}, evidence, MODEL, **more)  # type: ignore[arg-type]  # sides


@pytest.mark.parametrize("pan_px", [0.0, 2.0])
def test_an_object_that_moves_with_the_hand_is_touched(pan_px: float) -> None:
    """Its outline is sharp while it moves, with a static and with a panning camera."""
    clip = made(pan_px=pan_px)
    found = found_in(clip)
    for k in range(10, 17):
        index = int(found.contact["right"][k])
        assert index != NOTHING and iou(found.objects[index].segments[k].mask, clip.card[k]) > 0.7
    assert (found.contact["left"] == NOTHING).all()


def test_an_object_is_followed_before_the_touch() -> None:
    """The card rests at its first place while the hand comes."""
    clip = made()
    found = found_in(clip)
    index = int(found.contact["right"][12])
    first = min(found.objects[index].segments)
    assert first <= 3 and iou(found.objects[index].segments[first].mask, clip.card[first]) > 0.6


@pytest.mark.parametrize("pan_px", [0.0, 2.0])
def test_an_object_that_the_hand_leaves_behind_is_not_touched(pan_px: float) -> None:
    found = found_in(made(held=False, pan_px=pan_px))
    assert (found.contact["right"][12:] == NOTHING).all()


@pytest.mark.parametrize("card", [True, False])
def test_a_sleeve_is_no_object(card: bool) -> None:
    """A sleeve moves with the hand and leaves the picture behind it."""
    clip = made(sleeve=True, card=card)
    found = found_in(clip)
    for track in found.objects:
        for k, segment in track.segments.items():
            assert (segment.mask & clip.sleeve[k]).sum() < 0.2 * segment.mask.sum() + 60
    assert card or (found.contact["right"] == NOTHING).mean() > 0.8


def test_touched_objects_are_the_same_in_every_run() -> None:
    one, other = (found_in(made(pan_px=2.0)) for _ in range(2))
    assert np.array_equal(one.contact["right"], other.contact["right"]) and len(one.objects) == len(other.objects)
    assert all(np.array_equal(a.segments[k].mask, b.segments[k].mask)
               for a, b in zip(one.objects, other.objects, strict=True) for k in a.segments)  # fmt: skip


def test_a_clip_without_hands_has_no_touched_objects() -> None:
    clip = made()
    clip.hand[:] = False
    found = found_in(clip)
    assert not found.objects and not found.reasons and (found.contact["right"] == NOTHING).all()


@pytest.mark.parametrize("pan_px", [0.0, 2.0])
def test_the_background_explains_what_does_not_move(pan_px: float) -> None:
    clip = made(pan_px=pan_px)
    background = StillBackground(clip.sampled, range(COUNT), list(clip.hand))
    assert background.static == (pan_px == 0)
    found = background.unexplained(13)
    away, card = (mask[::2, ::2] for mask in (~(clip.card | clip.hand).any(0), clip.card[13]))
    assert np.median(found.either[away]) < 0.05 and np.median(found.both[card]) > 0.3


def test_a_forearm_runs_from_the_wrist_out_of_the_picture() -> None:
    """The direction follows the foreground, on the side of the person."""
    hand, fore = np.zeros((HEIGHT, WIDTH), bool), np.zeros((HEIGHT, WIDTH), np.float32)
    hand[50:70, 100:120] = True
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    arm = (abs(x - 110 - 0.6 * (y - 60)) < 9) & (y > 72)
    fore[arm] = 1
    strip = forearms([hand], [None], [None], [fore], (1, 1))[0]
    assert (strip & arm).sum() > 0.85 * arm.sum() and not strip[:50].any()


def test_finger_contact_falls_with_distance() -> None:
    thing = np.zeros((HEIGHT, WIDTH), bool)
    thing[40:60, 100:140] = True
    points = np.full((21, 2), (60.0, 100.0), np.float32)
    points[9] = (60, 70)
    points[[4, 8, 12, 16, 20]] = [(110, 50), (110, 62), (110, 66), (110, 80), (20, 20)]
    contact = finger_contact(thing, points)
    assert contact[0] == 1 and (np.diff(contact) < 0).all() and contact[4] < 0.01
    assert not finger_contact(np.zeros_like(thing), points).any()


def test_a_hand_with_keypoints_grips_at_its_fingers_alone() -> None:
    hand = np.zeros((HEIGHT, WIDTH), bool)
    hand[40:128, 100:120] = True
    points = np.stack([np.linspace(104, 116, 21), np.linspace(80, 44, 21)], -1).astype(np.float32)
    points[0], points[9] = (110, 84), (110, 60)
    ring = grip_ring(hand, points, 4)
    assert ring[40:60].any() and not ring[110:].any() and grip_ring(hand, None, 4)[110:].any()


def test_keypoints_of_low_confidence_are_none() -> None:
    points = HandKeypoints(np.zeros((2, 21, 2), np.float32), np.stack([np.zeros(21), np.ones(21)]).astype(np.float32))
    assert points.at(0) is None and points.at(1) is not None


def test_holes_are_filled_up_to_half_of_the_object() -> None:
    ring, empty = np.zeros((60, 60), bool), np.zeros((60, 60), bool)
    ring[10:50, 10:50] = True
    small, large = ring.copy(), ring.copy()
    small[25:35, 25:35] = False
    large[12:48, 12:48] = False
    assert np.array_equal(fill_holes(small, empty), ring) and np.array_equal(fill_holes(large, empty), large)
