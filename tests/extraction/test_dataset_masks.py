"""Mask encodings: run lengths and PNG are lossless."""

from __future__ import annotations

import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from afford.dataset import masks

ANY_MASK = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(lambda size: arrays(bool, size))


@given(ANY_MASK)
def test_png_is_exact(mask):
    """Any PNG reader restores the mask, with one bit per pixel."""
    image = Image.open(io.BytesIO(masks.encode_png(mask)))
    assert image.mode == "1"
    assert np.array_equal(np.asarray(image), mask)
    assert np.array_equal(masks.decode_png(masks.encode_png(mask)), mask)


@given(ANY_MASK)
def test_png_of_others_is_read_too(mask):
    """PNG files of other writers are decoded, with one bit or eight."""
    for image in (Image.fromarray(mask), Image.fromarray(mask.astype(np.uint8) * 255)):
        file = io.BytesIO()
        image.save(file, "PNG")
        assert np.array_equal(masks.decode_png(file.getvalue()), mask)


@given(ANY_MASK)
def test_rle_is_exact(mask):
    """Encoding and decoding keep bits, area and box."""
    both = np.stack([mask, ~mask])
    counts = masks.encode_rle(both)
    assert np.array_equal(masks.decode_rle(counts, *mask.shape), both)
    assert masks.areas(counts, *mask.shape) == [mask.sum(), (~mask).sum()]


def test_rle_does_not_care_about_memory_layout():
    """A transposed view encodes like its copy."""
    mask = np.random.default_rng(0).random((3, 20, 30)) < 0.3
    view = mask.transpose(0, 2, 1)
    assert masks.encode_rle(view) == masks.encode_rle(view.copy())
