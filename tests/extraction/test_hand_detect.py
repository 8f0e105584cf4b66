"""Laws of hand_detect: hands that a finder half sees become key frames with sides, objects and touches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from afford.common.masks import dilate, iou
from afford.extraction.hands import LEFT, RIGHT, SLEEVE, TOUCHED
from afford.extraction.hands.detect import Finder, detect
from afford.extraction.sources.narrations import default_narration
from afford.extraction.sources.outlines import fill
from schemas.video import NOT_IN_CONTACT, Annotation, Clip, Frames, KeyFrame
from stages.extraction.hand_detect import Params
from tests.helpers.toy_clip import Toy, texture, toy

COUNT = 25
PARAMS = Params(every_s=0.2, look_s=0.034, least_hand=0.005, least_object=0.005, least_found=0.1)
Masks = dict[int, np.ndarray]
"""column of a finder's answer -> mask (t, h, w) bool"""


def clip_of(frames: Frames, **more: Any) -> Clip:
    last = int(frames.frame[-1])
    plain = Clip("toy", "toy", "toy", "", ("toy.mp4",), "video", 30.0, False, 1, last, (), (default_narration(1, last),), ())
    return replace(plain, **more)


def detect_clip(clip: Clip, frames: Frames, find: Finder, params: Params) -> Clip:
    """Detect without landmarks."""
    return detect(clip, frames, find, params).clip


def finder(frames: Frames, masks: Masks, noise: float = 0.0, blind: tuple[int, ...] = ()) -> Finder:
    """One that says the masks, blurred and noisy, of pictures that it knows; of those of `blind` frames it says nothing."""
    known = {picture.tobytes(): t for t, picture in enumerate(frames.rgb)}

    def find(rgb: np.ndarray) -> np.ndarray:
        out = np.zeros((*rgb.shape[:3], 4), np.float32)
        for n, picture in enumerate(rgb):
            t = known[picture.tobytes()]
            for column, mask in masks.items():
                out[n, ..., column] = 0 if t in blind else cv2.GaussianBlur(mask[t].astype(np.float32), (0, 0), 2)
            out[n] += np.random.default_rng(t).normal(0, noise, out[n].shape) if noise else 0
        return np.clip(out, 0, 1)

    return find


def made(side: int = RIGHT) -> tuple[Toy, Masks]:
    """A hand that comes, holds a card, and goes."""
    clip = toy(COUNT)
    hand, card = clip.tracks.masks[1], clip.tracks.masks[2]
    return clip, {side: hand, TOUCHED: card & (clip.tracks.contact[1] >= 0)[:, None, None]}


def drawn(key: KeyFrame, annotation: Annotation) -> np.ndarray:
    return fill(annotation.polygons, key.width_px, key.height_px) > 0


def of(key: KeyFrame, side: str) -> list[Annotation]:
    return [a for a in key.annotations if a.side == side]


def test_hands_are_found() -> None:
    """Key frames contain each hand with its side; the finder may be noisy, and fail for a moment."""
    clip, masks = made()
    found = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, masks, 0.2, (8, 9)), PARAMS)
    assert len(found.key_frames) >= 4
    for key in found.key_frames:
        truth = masks[RIGHT][key.frame - 1]
        assert bool(of(key, "right")) == (truth.sum() > 100) and not of(key, "left")
        for hand in of(key, "right"):
            assert iou(drawn(key, hand), truth) > 0.7


def test_a_hand_touches_what_it_holds() -> None:
    """A touch names an annotation of its frame that lies beside the hand; the thing keeps its name; hands stay free of it."""
    clip, masks = made()
    found = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, masks, 0.1), PARAMS)
    touches = 0
    for key in found.key_frames:
        by_id = {a.annotation_id: a for a in key.annotations}
        for hand in of(key, "right"):
            if hand.contact not in NOT_IN_CONTACT:
                touches += 1
                thing = by_id[hand.contact]
                assert thing.side == "" and thing.name == "object"
                assert (dilate(drawn(key, hand), PARAMS.reach_px + 1) & drawn(key, thing)).any()
                assert iou(drawn(key, thing), masks[TOUCHED][key.frame - 1]) > 0.5
        assert all({a.contact for a in key.annotations if not a.side} <= {""} for key in found.key_frames)
    assert touches >= 2


def test_a_sleeve_is_not_a_touched_object() -> None:
    """A segment with a high sleeve probability is no object, although it moves with the hand."""
    clip, masks = made()
    for said, touched in ((masks, True), ({**masks, SLEEVE: masks[TOUCHED]}, False)):
        found = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, said), PARAMS)
        assert any(one.contact not in NOT_IN_CONTACT for key in found.key_frames for one in of(key, "right")) == touched


def test_the_only_touched_object_gets_the_noun_of_the_narration() -> None:
    """The object also gets the class of the noun."""
    clip, masks = made()
    said = replace(default_narration(1, COUNT), noun="card", noun_class=7)
    found = detect_clip(clip_of(clip.frames, narrations=(said,)), clip.frames, finder(clip.frames, masks), PARAMS)
    assert {(a.name, a.class_id) for key in found.key_frames for a in key.annotations if not a.side} == {("card", 7)}


def test_a_mirror_swaps_the_sides() -> None:
    """Mirrored frames have the same key frames, with the hands on the other side."""
    clip, masks = made()
    mirrored = replace(clip.frames, rgb=np.ascontiguousarray(clip.frames.rgb[:, :, ::-1]))
    other = {LEFT: masks[RIGHT][:, :, ::-1], TOUCHED: masks[TOUCHED][:, :, ::-1]}
    one = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, masks), PARAMS)
    two = detect_clip(clip_of(mirrored), mirrored, finder(mirrored, other), PARAMS)
    for a, b in zip(one.key_frames, two.key_frames, strict=True):
        assert [len(of(a, side)) for side in ("left", "right")] == [len(of(b, side)) for side in ("right", "left")]
        for left, right in zip(of(b, "left"), of(a, "right"), strict=True):
            assert iou(drawn(b, left)[:, ::-1], drawn(a, right)) > 0.9


def test_pictures_of_a_facing_person_are_rotated() -> None:
    """The backend gets pictures rotated by 180 degrees, and its output is rotated back."""
    clip, masks = made()
    turned = replace(clip.frames, rgb=np.ascontiguousarray(clip.frames.rgb[:, ::-1, ::-1]))
    plain = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, masks), PARAMS)
    facing = detect_clip(clip_of(turned), turned, finder(clip.frames, masks), replace(PARAMS, viewpoint="facing"))
    for a, b in zip(plain.key_frames, facing.key_frames, strict=True):
        for upright, upside_down in zip(of(a, "right"), of(b, "right"), strict=True):
            assert iou(drawn(a, upright), drawn(b, upside_down)[::-1, ::-1]) > 0.9


def pair(lean: Callable[[int], tuple[int, int]]) -> tuple[Frames, Masks]:
    """Two hands that lie still, the one on the left first; `lean` says which columns the finder takes them for in each frame."""
    rng = np.random.default_rng(0)
    ground = texture(rng, 96, 160, (90, 110, 130))
    hands = [cv2.circle(np.zeros((96, 160), np.uint8), (x, 70), 14, 1, -1) > 0 for x in (40, 115)]
    rgb = np.stack([np.where((hands[0] | hands[1])[..., None], 190, ground) + rng.normal(0, 2, ground.shape) for _ in range(12)])
    masks = {column: np.zeros(rgb.shape[:3], bool) for column in (LEFT, RIGHT)}
    for t in range(12):
        for mask, column in zip(hands, lean(t), strict=True):
            masks[column][t] |= mask
    number = np.arange(1, 13)
    return Frames("toy", number, number * 33_333_333, np.clip(rgb, 0, 255).astype(np.uint8)), masks


@pytest.mark.parametrize("lean", [lambda t: (RIGHT, RIGHT) if t in (4, 5, 9) else (LEFT, RIGHT), lambda t: (RIGHT, RIGHT)])
def test_a_hand_has_one_side_all_its_life(lean: Callable[[int], tuple[int, int]]) -> None:
    """Single looks are outvoted, and two hands are never the same one."""
    frames, masks = pair(lean)
    for key in detect_clip(clip_of(frames), frames, finder(frames, masks), PARAMS).key_frames:
        centres = [np.flatnonzero(drawn(key, of(key, side)[0]).any(0)).mean() for side in ("left", "right")]
        assert centres[0] < 80 < centres[1]


def test_a_clip_without_hands_has_empty_key_frames() -> None:
    """A segment in a single sampled frame is no hand."""
    clip, masks = made()
    nothing = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, {}, 0.1), PARAMS)
    others = tuple(t for t in range(COUNT) if t != 12)
    blink = detect_clip(clip_of(clip.frames), clip.frames, finder(clip.frames, masks, blind=others), PARAMS)
    for found in (nothing, blink):
        assert found.key_frames and not any(key.annotations for key in found.key_frames)


def test_frames_across_gaps_are_independent() -> None:
    """Frames without neighbours are key frames, and a hand in one of them counts."""
    clip, masks = made()
    few = slice(6, 20, 6)
    frames = Frames("toy", clip.frames.frame[few], clip.frames.time_ns[few], clip.frames.rgb[few])
    found = detect_clip(clip_of(frames), frames, finder(frames, {k: m[few] for k, m in masks.items()}), PARAMS)
    assert [key.frame for key in found.key_frames] == frames.frame.tolist()
    assert all(len(of(key, "right")) == 1 for key in found.key_frames)
