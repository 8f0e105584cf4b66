"""Encoding of images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.common.image_files import encode_jpeg, encode_png


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (7, 5, 3), (7, 5, 4)])
def test_png_is_lossless(shape: tuple[int, ...]) -> None:
    """Check grey, colour and transparency, also for a view of a larger image."""
    picture = np.random.default_rng(0).integers(0, 256, (shape[0] + 2, shape[1] + 3, *shape[2:]), np.uint8)[1:-1, 3:]
    data = encode_png(picture)
    assert data.dtype == np.uint8 and data.ndim == 1
    assert np.array_equal(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), picture)


def test_jpeg_keeps_channels_and_quality() -> None:
    """Check that channels are RGB and a lower quality is smaller."""
    red = np.zeros((32, 32, 3), np.uint8)
    red[..., 0] = np.linspace(100, 250, 32)
    back = cv2.imdecode(encode_jpeg(red, 95), cv2.IMREAD_COLOR_RGB).astype(int)
    assert np.abs(back - red).max() < 12 and len(encode_jpeg(red, 30)) < len(encode_jpeg(red, 95))
