"""Thinning keeps every n-th key frame and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from schemas.video import Clip, KeyFrame
from stages.extraction import key_thin


def clip(frames: tuple[int, ...]) -> Clip:
    keys = tuple(KeyFrame(frame, 1920, 1080, ()) for frame in frames)
    return Clip("P91_01", "P91_01", "P91", "train", ("v.mp4",), "video", 30.0, False, 1, 61, keys, (), ())


def test_stride_two_doubles_the_gap() -> None:
    """Frames 1, 16, 31, 46, 61 become 1, 31, 61."""
    thin = key_thin.run(clip((1, 16, 31, 46, 61)), key_thin.Params(2))
    assert [key.frame for key in thin.key_frames] == [1, 31, 61]


def test_stride_one_is_the_identity() -> None:
    """Stride 1 keeps all key frames; any stride keeps all other fields."""
    whole = clip((1, 16, 31))
    assert key_thin.run(whole, key_thin.Params(1)) == whole
    assert replace(key_thin.run(whole, key_thin.Params(2)), key_frames=whole.key_frames) == whole


def test_a_stride_of_zero_is_refused() -> None:
    """The message names the parameter."""
    with pytest.raises(ValueError, match=r"key_thin\.stride"):
        key_thin.run(clip((1,)), key_thin.Params(0))
