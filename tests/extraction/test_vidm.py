"""VIDM as a backend, with the real loading and sampling code, on a tiny random model that the test saves itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.extraction.inpaint.vidm import context_frames
from schemas.video import Inpainted, PixelSource
from stages.extraction import hand_inpaint
from stages.extraction.hand_inpaint import Params
from tests.helpers.blocks import changed
from tests.helpers.tiny_inpainters import save_vidm
from tests.helpers.toy_clip import Toy, toy


@pytest.fixture(scope="module")
def clip() -> Toy:
    return toy(rows=slice(None, None, 5))


@pytest.fixture(scope="module")
def params(tmp_path_factory: pytest.TempPathFactory) -> Params:
    folder = save_vidm(tmp_path_factory.mktemp("vidm"))
    return changed(Params(backend="vidm"), model=str(folder), device="cpu", ddim_steps=2, seed=7)


@pytest.fixture(scope="module")
def found(clip: Toy, params: Params) -> Inpainted:
    return run(clip, params)


def run(clip: Toy, params: Params) -> Inpainted:
    return hand_inpaint.run(clip.frames, clip.tracks, params)


def test_pixels_outside_the_mask_are_unchanged(clip: Toy, found: Inpainted) -> None:
    """Pixels inside the mask have confidence 128."""
    assert found.rgb.shape == clip.frames.rgb.shape and found.rgb.dtype == np.uint8 and found.mask.any()
    assert np.array_equal(found.rgb[~found.mask], clip.frames.rgb[~found.mask])
    assert (found.rgb[found.mask] != clip.frames.rgb[found.mask]).any(axis=1).mean() > 0.9
    assert (found.source[found.mask] == PixelSource.BACKGROUND).all() and (found.confidence[found.mask] == 128).all()


def test_same_seed_same_bytes(clip: Toy, params: Params, found: Inpainted) -> None:
    """The noise comes from the seed alone, in whatever batches; another seed and no fresh noise are other pictures."""
    assert run(clip, params).rgb.tobytes() == found.rgb.tobytes()
    one = run(clip, changed(params, batch=1)).rgb
    assert (np.abs(one.astype(int) - found.rgb) > 1).mean() < 0.01  # convolutions of other batches may end in other last bits
    for other in (changed(params, seed=8), changed(params, ddim_eta=0.0), changed(params, ddim_steps=3)):
        assert run(clip, other).rgb.tobytes() != found.rgb.tobytes()


def test_output_depends_on_weights(clip: Toy, params: Params, found: Inpainted, tmp_path: Path) -> None:
    """The fill depends on the checkpoint."""
    assert not np.array_equal(run(clip, changed(params, model=str(save_vidm(tmp_path, seed=1)))).rgb, found.rgb)


def test_other_frames_are_looked_at(clip: Toy, params: Params, found: Inpainted) -> None:
    """Another picture in one frame changes what is painted in another one."""
    rgb = clip.frames.rgb.copy()
    rgb[0] = 255 - rgb[0]
    other = hand_inpaint.run(replace(clip.frames, rgb=rgb), clip.tracks, params)
    at = int(np.flatnonzero(found.mask.any(axis=(1, 2)))[-1])
    assert at > 0 and not np.array_equal(other.rgb[at], found.rgb[at])


@pytest.mark.parametrize("change", [{"window_px": 64}, {"window_frames": 4}, {"dtype": "bfloat16"}])
def test_windows_and_types_are_choices(clip: Toy, params: Params, found: Inpainted, change: dict[str, object]) -> None:
    """Each gives another picture, again inside the mask only."""
    other = run(clip, changed(params, **change))
    assert not np.array_equal(other.rgb, found.rgb)
    assert np.array_equal(other.rgb[~other.mask], clip.frames.rgb[~other.mask])


def test_a_clip_without_hands_needs_no_model(clip: Toy) -> None:
    """The model is not loaded without holes."""
    away = replace(clip.tracks, masks=np.zeros_like(clip.tracks.masks))
    out = hand_inpaint.run(clip.frames, away, Params(backend="vidm"))
    assert np.array_equal(out.rgb, clip.frames.rgb)


def test_one_frame_is_a_clip(params: Params) -> None:
    """A single frame is its own context."""
    assert run(toy(count=25, rows=slice(12, 13)), params).mask.any()


@pytest.mark.parametrize(("change", "message"), [
    ({"model": ""}, "needs a model: expected the published checkpoint"),
    ({"model": "/nowhere"}, "'/nowhere', which does not exist"),
    ({"ddim_steps": 0}, "ddim_steps: expected 1 to 500"), ({"ddim_steps": 501}, "got 501"), ({"batch": 0}, "batch: expected 1"),
    ({"device": "tpu"}, "device 'tpu': expected cpu, cuda or cuda:N"), ({"dtype": "int8"}, "dtype 'int8': expected one of float32"),
    ({"window_px": 8}, "window_px: expected 0 or 64")])  # fmt: skip
def test_invalid_parameters_are_refused(clip: Toy, params: Params, change: dict[str, object], message: str) -> None:
    """Each error is one sentence."""
    with pytest.raises(ValueError, match=message) as error:
        run(clip, changed(params, **change))
    assert "\n" not in str(error.value)


def test_the_target_is_last_and_the_others_keep_their_order() -> None:
    """Four frames give each frame once as the target, as the released script has them; a stretch stays within the clip."""
    assert [context_frames(t, 4, 4) for t in range(4)] == [[1, 2, 3, 0], [0, 2, 3, 1], [0, 1, 3, 2], [0, 1, 2, 3]]
    assert context_frames(50, 100, 4, within=8) == [46, 48, 52, 50] and context_frames(50, 100, 4) == [0, 25, 75, 50]
    assert all(0 <= i < 100 for t in (0, 99) for i in context_frames(t, 100, 4, within=8))
    assert context_frames(0, 1, 4) == [0, 0, 0, 0]
