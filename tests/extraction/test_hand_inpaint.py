"""hand_inpaint removes hands, and nothing but hands."""

from __future__ import annotations

import numpy as np
import pytest

from afford.common.masks import dilate, psnr_db
from schemas.video import PixelSource
from stages.extraction import hand_inpaint
from stages.extraction.hand_inpaint import Params
from tests.helpers.toy_clip import Toy, toy

BACKENDS = ("layered", "median", "telea")


@pytest.fixture(scope="module")
def clip() -> Toy:
    return toy()


def quality_db(clip: Toy, backend: str) -> float:
    inpainted = hand_inpaint.run(clip.frames, clip.tracks, Params(backend=backend))
    scores = [psnr_db(*row) for row in zip(inpainted.rgb, clip.clean, clip.tracks.masks[1], strict=True)]
    return float(np.nanmean(scores))


@pytest.mark.parametrize("backend", BACKENDS)
def test_pixels_outside_the_mask_are_unchanged(clip: Toy, backend: str) -> None:
    """Pixels outside have source ORIGINAL and full confidence; the mask is the hands grown by `dilate_px`."""
    inpainted = hand_inpaint.run(clip.frames, clip.tracks, Params(backend=backend, dilate_px=2))
    assert np.array_equal(inpainted.mask, dilate(clip.tracks.masks[1], 2))
    assert np.array_equal(inpainted.rgb[~inpainted.mask], clip.frames.rgb[~inpainted.mask])
    assert (inpainted.source[~inpainted.mask] == PixelSource.ORIGINAL).all()
    assert (inpainted.confidence[~inpainted.mask] == 255).all()
    assert (inpainted.source[inpainted.mask] != PixelSource.ORIGINAL).all()


def test_layers_beat_the_background_alone_and_the_single_frame(clip: Toy) -> None:
    """Behind the hand: layered > median > telea."""
    layered, median, telea = (quality_db(clip, backend) for backend in ("layered", "median", "telea"))
    assert layered > 27
    assert layered > median + 3
    assert median > telea


def test_object_pixels_come_from_the_object(clip: Toy) -> None:
    """Most hidden pixels of the card are marked OBJECT, and few others are."""
    inpainted = hand_inpaint.run(clip.frames, clip.tracks, Params())
    found, hidden = inpainted.source == PixelSource.OBJECT, clip.amodal & clip.tracks.masks[1]
    assert np.count_nonzero(found & hidden) > 0.9 * np.count_nonzero(hidden)
    assert np.count_nonzero(found & ~clip.amodal) < 0.1 * np.count_nonzero(hidden)


def test_same_bytes_twice(clip: Toy) -> None:
    """Two runs agree in every pixel."""
    first, second = (hand_inpaint.run(clip.frames, clip.tracks, Params()) for _ in range(2))
    assert np.array_equal(first.rgb, second.rgb)
    assert np.array_equal(first.confidence, second.confidence)


@pytest.mark.parametrize("every", [6, 25])
def test_few_far_apart_frames(every: int) -> None:
    """Five frames far apart, and a single one, are filled all the same."""
    clip = toy(rows=slice(None, None, every))
    inpainted = hand_inpaint.run(clip.frames, clip.tracks, Params())
    assert np.isin(inpainted.source[inpainted.mask], [PixelSource.BACKGROUND, PixelSource.OBJECT, PixelSource.SPATIAL]).all()


def test_a_single_frame_is_filled_spatially() -> None:
    """A single frame has no source frames: source SPATIAL, confidence 0."""
    clip = toy(count=25, rows=slice(12, 13))
    inpainted = hand_inpaint.run(clip.frames, clip.tracks, Params())
    assert inpainted.mask.any()
    assert (inpainted.source[inpainted.mask] == PixelSource.SPATIAL).all()
    assert (inpainted.confidence[inpainted.mask] == 0).all()


def test_other_frames_are_refused(clip: Toy) -> None:
    """Tracks of other frames give one clear sentence."""
    with pytest.raises(ValueError, match="expected masks of the 5 frames"):
        hand_inpaint.run(toy(rows=slice(None, None, 6)).frames, clip.tracks, Params())
