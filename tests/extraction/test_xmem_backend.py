"""XMem as a backend of mask_densify: passes in both directions, several objects, memory, determinism."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from afford.extraction.tracks import UNKNOWN, Xmem
from afford.extraction.tracks.xmem import propagate
from afford.models.xmem import aggregate, load_model, picture, session, track_frames
from afford.models.xmem_memory import MemorySize
from afford.models.xmem_network import XMem, gated
from stages.extraction.mask_densify import Params, run
from tests.helpers.moving_shapes import CUP, HAND, annotate, clip_of, film, frames_of, key_frame
from tests.helpers.tiny_models import XMEM, save_xmem


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_xmem(tmp_path_factory.mktemp("xmem") / "XMem.pth")


def params(model: Path, **more: Any) -> Xmem:
    return Xmem(**({"model": str(model), "short_side_px": 48, "stride_frames": 2} | more))


def stretch(params: Xmem, count: int = 7) -> np.ndarray:
    """Labels of a short random video with two objects and key frames near its ends."""
    rgb = np.random.default_rng(0).integers(0, 255, (count, 48, 80, 3), np.uint8)
    labels = np.zeros((2, 48, 80), np.int16)
    labels[:, 10:30, 10:30], labels[1, 10:30, 50:70] = 1, 2
    return propagate(rgb, np.array([1, count - 2]), labels, 2, params).labels


def test_a_clip_through_the_stage(model: Path) -> None:
    """Key masks stay; other frames have valid masks that do not overlap, of hand and cup at once, and confidences in 0..1."""
    rgb, labels = film(6)
    keys = [key_frame(n, annotate(n, labels[n - 1] == HAND, "right hand", "right", f"cup@{n}"),
                      annotate(n, labels[n - 1] == CUP, "cup")) for n in (1, 6)]  # fmt: skip
    chosen = Params(backend="xmem", xmem=params(model, short_side_px=64))
    tracks = run(clip_of(keys, 6), frames_of(rgb), chosen)
    assert [entity.entity_id for entity in tracks.entities] == ["right hand", "cup"]
    assert np.array_equal(tracks.masks[0, 0], labels[0] == HAND) and np.array_equal(tracks.masks[1, 5], labels[5] == CUP)
    assert tracks.masks.shape == (2, *rgb.shape[:3]) and (tracks.masks.sum(axis=0) <= 1).all()
    assert ((tracks.confidence >= 0) & (tracks.confidence <= 1)).all() and (tracks.confidence[:, [0, 5]] == 1).all()
    assert tracks.masks[:, 1:5].any()


def test_key_labels_are_kept_and_unknown_pixels_are_background(model: Path) -> None:
    rgb = np.random.default_rng(1).integers(0, 255, (4, 48, 64, 3), np.uint8)
    labels = np.zeros((2, 48, 64), np.int16)
    labels[:, 4:20, 4:20], labels[:, 8:28, 28:44], labels[0, 0, 0] = 1, 2, UNKNOWN
    found = propagate(rgb, np.array([0, 3]), labels, 2, params(model))
    assert np.array_equal(found.labels[[0, 3]], np.where(labels == UNKNOWN, 0, labels))
    assert found.labels.min() >= 0 and found.labels.max() <= 2


def test_masks_are_deterministic_and_depend_on_weights_and_memory(model: Path, tmp_path: Path) -> None:
    """The same bytes twice; other weights, another set of key frames in memory or another stride give other labels."""
    found = stretch(params(model))
    assert found.tobytes() == stretch(params(model)).tobytes()
    assert not np.array_equal(found, stretch(params(save_xmem(tmp_path / "other.pth", seed=1))))
    assert stretch(params(model, dtype="bfloat16")).shape == found.shape
    usual = odds(model)
    for more in ({"alone": True}, {"every": 1}, {"size": MemorySize(top_k=1)}):
        assert not torch.equal(usual, odds(model, **more)), more


def odds(model: Path, **more: Any) -> torch.Tensor:
    """Logits of the sixth frame of a pass with two key frames in memory."""
    rgb = np.random.default_rng(2).integers(0, 255, (8, 48, 64, 3), np.uint8)
    masks = np.zeros((2, 48, 64), bool)
    masks[0, 5:25, 5:25], masks[1, 20:40, 30:50] = True, True
    made = session(load_model(str(model)), rgb, {0: masks, 7: masks[::-1]}, 48)
    return [seen.logits for seen in track_frames(made, range(7), **{"every": 3, **more})][-1]


def test_a_long_pass_through_a_small_memory(model: Path) -> None:
    """Consolidation does not disturb a pass; every frame gets finite logits at the size of the video."""
    rgb = np.random.default_rng(3).integers(0, 255, (30, 40, 56, 3), np.uint8)
    made = session(load_model(str(model)), rgb, {29: np.ones((1, 40, 56), bool)}, 32)
    found = list(track_frames(made, range(29, -1, -1), every=1, size=MemorySize(5, 2, 4, 6, 12)))
    assert [seen.at for seen in found] == list(range(28, -1, -1))
    assert all(seen.logits.shape == (1, 40, 56) and seen.logits.isfinite().all() for seen in found)
    with pytest.raises(ValueError, match=r"begins at a key frame, got frame 3 and key frames \[29\]"):
        next(track_frames(made, [3, 4]))


def test_soft_aggregation() -> None:
    """Probabilities sum to 1; hard masks come back; the background wins where no object is likely."""
    given = torch.tensor([[0.0, 1.0, 0.45, 0.3], [0.0, 0.0, 0.45, 0.1]])[:, None]
    found = aggregate(given)
    assert torch.allclose(found.sum(dim=0), torch.ones(1, 4))
    assert torch.allclose(found[1:, 0, :2], given[:, 0, :2], atol=1e-6)
    assert found.argmax(dim=0).tolist() == [[0, 1, 1, 0]]


def test_a_closed_update_gate_keeps_the_sensory_memory() -> None:
    """A closed update gate leaves the old state to the forget gate; an open one replaces it by the candidate."""
    hidden = torch.randn(1, 2, 1, 1, generator=torch.Generator().manual_seed(0))
    values = torch.tensor([50.0, 50.0, -50.0, -50.0, 9.0, 9.0]).view(1, 6, 1, 1)
    assert torch.allclose(gated(values, hidden), hidden)
    values[:, 2:4] = 50.0
    assert torch.allclose(gated(values, hidden), torch.ones(1, 2, 1, 1), atol=1e-6)


def test_objects_are_equivariant(model: Path) -> None:
    """Objects in another order give the same logits in that order."""
    net = load_model(str(model))
    rgb = np.random.default_rng(4).integers(0, 255, (3, 32, 48, 3), np.uint8)
    masks = np.zeros((3, 32, 48), bool)
    masks[0, 2:12, 2:12], masks[1, 14:30, 6:20], masks[2, 5:25, 25:45] = True, True, True
    one, other = ([seen.logits for seen in track_frames(session(net, rgb, {0: order}, 32), range(3), every=1)]
                  for order in (masks, masks[[2, 0, 1]]))  # fmt: skip
    assert all(torch.allclose(a[[2, 0, 1]], b, atol=1e-4) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(("shape", "expected"), [((48, 80), (48, 80)), ((50, 61), (48, 64)), ((100, 40), (128, 48))])
def test_pictures_are_multiples_of_the_stride(shape: tuple[int, int], expected: tuple[int, int]) -> None:
    """Scaled to a shorter side of 48 px and padded equally; portrait and landscape."""
    rgb = np.full((1, *shape, 3), 255, np.uint8)
    made = session(XMem(XMEM).eval(), rgb, {}, 48)
    assert picture(made, 0).shape == (1, 3, *expected)


def test_bounds_of_the_memory_are_checked(model: Path) -> None:
    """The wrong Params are named before a model is read."""
    with pytest.raises(ValueError, match="expected 1 <= least_frames < most_frames, got 10 and 10"):
        stretch(dataclasses.replace(params(model), model="/nowhere", least_frames=10))
