"""Windows around holes: every pixel of a hole is in one, and pixels of a window that fits are never scaled."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from afford.extraction.inpaint.windows import Window, chunks, cut, cut_hole, paste, windows

H, W = 90, 150


def holes(seed: int, count: int) -> np.ndarray:
    """(H, W) bool: some rectangles."""
    rng, hole = np.random.default_rng(seed), np.zeros((H, W), bool)
    for _ in range(count):
        y, x = rng.integers(0, H), rng.integers(0, W)
        hole[y : y + rng.integers(1, 60), x : x + rng.integers(1, 100)] = True
    return hole


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 4), side=st.sampled_from([64, 90, 128, 200]))
def test_windows_cover_every_hole(seed: int, count: int, side: int) -> None:
    """Windows are squares of `side`, larger only around a larger patch, and inside the frame where they fit."""
    hole = holes(seed, count)
    left = hole.copy()
    for window in windows(hole, side):
        assert window.side >= side
        assert window.side > min(H, W) or (window.y >= 0 and window.x >= 0)
        assert left[window.inside(hole.shape)].any()
        left[window.inside(hole.shape)] = False
    assert not left.any()


@pytest.mark.parametrize("window", [Window(3, 20, 64), Window(-10, 50, 100), Window(-60, 0, 150), Window(-110, -50, 200)])
def test_cut_and_paste_without_scaling_is_exact(window: Window) -> None:
    """Pixels outside `where` are unchanged, and pixels outside the frame are black."""
    frame = np.random.default_rng(0).integers(1, 256, (H, W, 3), np.uint8)
    piece, where = cut(frame, window, window.side), holes(1, 3)
    inside = np.zeros((H, W), bool)
    inside[window.inside(frame.shape)] = True
    assert (piece == 0).all(axis=2).sum() == window.side**2 - inside.sum()
    out = np.zeros_like(frame)
    paste(out, window, piece, where)
    assert np.array_equal(out[where & inside], frame[where & inside]) and not out[~(where & inside)].any()


@pytest.mark.parametrize("size", [40, 64, 97])
def test_a_scaled_hole_leaves_nothing_out(size: int) -> None:
    """A single pixel is still there when a window is shrunk, and its answer lands on it."""
    window = Window(10, 30, 64)
    for y, x in ((10, 30), (40, 60), (73, 93)):
        hole = np.zeros((H, W), bool)
        hole[y, x] = True
        small = cut_hole(hole, window, size)
        assert small.any()
        out = np.zeros((H, W, 3), np.uint8)
        paste(out, window, np.full((size, size, 3), 200, np.uint8), hole)
        assert (out[y, x] == 200).all() and np.count_nonzero(out) == 3


def test_chunks() -> None:
    """Chunks contain all items in order."""
    assert chunks([1, 2, 3], 2) == [[1, 2], [3]] and chunks([], 2) == []
