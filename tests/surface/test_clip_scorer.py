"""CLIP scorer on a tiny random model: shares, mask highlighting, caching by weights, refusals."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from transformers import CLIPConfig, CLIPModel

from afford.surface.negative import baselines
from afford.surface.negative.baselines import relevance
from afford.surface.negative.project import part_posterior, split_by_task
from afford.surface.score import Clip
from afford.surface.score.clip import highlighted
from schemas.files import FileTree
from schemas.surface import PartScores
from stages.surface import mask_score
from tests.helpers.learned_chain import content, flip_a_weight, run
from tests.helpers.made_objects import looked, projected
from tests.helpers.tiny_models import save_backbones

NONE = FileTree("none", ())
FOREIGN = ("刀刃", "the 🗡 of a 刀, 长", "the x of a y, " + "very " * 80 + "long", "the " + "Übergröße " * 60 + "of a z, ...", "?")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("tiny"))


def test_shares_of_a_task_sum_to_one(folder: Path) -> None:
    """Check that shares of each task sum to 1, cosines are in 0..1, and the projection runs with them."""
    x = looked()
    params = mask_score.Params("clip", Clip(str(folder)))
    found = mask_score.run(x.mesh, x.views, x.candidates, x.told, NONE, params)
    sizes = [len(one.notes) for one in x.told.descriptions]
    for part in np.split(found.share, np.cumsum(sizes)[:-1], axis=1):
        assert part.sum(1) == pytest.approx(1, abs=1e-5)
    assert found.share.shape == (len(x.candidates.view), sum(sizes)) and 0 <= found.overlap.min() <= found.overlap.max() <= 1
    assert np.ptp(found.overlap, axis=1).max() > 1e-6 and np.ptp(found.overlap, axis=0).max() > 1e-6  # words and masks matter
    assert len(projected(x, found).tasks) == len(sizes)


def test_candidates_below_least_cosine_have_no_share(folder: Path) -> None:
    """Check that no share is left above the largest cosine."""
    x = looked()
    params = mask_score.Params("clip", Clip(str(folder), least_cosine=1.1))
    found = mask_score.run(x.mesh, x.views, x.candidates, x.told, NONE, params)
    assert not found.share.any()


def test_unknown_objects_have_no_scores(folder: Path) -> None:
    """Check that no notes give no columns, and that a model must be named."""
    x = looked()
    silent = replace(x.told, descriptions=(replace(x.told.descriptions[0], notes=()),))
    params = mask_score.Params("clip", Clip(str(folder)))
    assert mask_score.run(x.mesh, x.views, x.candidates, silent, NONE, params).share.shape[1] == 0
    with pytest.raises(ValueError, match="needs a model"):
        mask_score.run(x.mesh, x.views, x.candidates, x.told, NONE, mask_score.Params("clip"))


def test_unknown_words_are_scored(folder: Path) -> None:
    """Check the shares of parts in any script, longer than the text window, and without a known word."""
    x = looked()
    notes = tuple(replace(x.told.notes[0], part=f"p{n}", phrase=phrase) for n, phrase in enumerate(FOREIGN))
    told = replace(x.told, descriptions=(replace(x.told.descriptions[0], notes=notes),))
    found = mask_score.run(x.mesh, x.views, x.candidates, told, NONE, mask_score.Params("clip", Clip(str(folder))))
    assert found.share.sum(1) == pytest.approx(1, abs=1e-5) and np.isfinite(found.overlap).all()


def test_surround_of_the_mask_is_blurred() -> None:
    """Check that pixels inside are unchanged and a checkerboard outside becomes grey."""
    board = (np.indices((64, 64)).sum(0) % 2 * 255).astype(np.uint8)
    rgb, mask = np.repeat(board[..., None], 3, -1), np.zeros((64, 64), bool)
    mask[20:40, 20:40] = True
    shown = highlighted(rgb, mask)
    assert np.array_equal(shown[mask], rgb[mask]) and np.abs(shown[~mask].astype(int) - 127).max() < 3


def test_baselines_use_the_same_model_on_windows(folder: Path) -> None:
    """Check that selected masks are candidates or the silhouette, and that relevance is a mean of shares."""
    x = looked()
    windows = x.windows()
    said = mask_score.run(x.mesh, x.views, windows, x.told, NONE, mask_score.Params("clip", Clip(str(folder))))
    one, fits = next(split_by_task(x.told, said))
    for view, mask in enumerate(baselines.coarse_box_recipe(x.views, x.candidates, windows, one, fits)):
        offered = [*x.candidates.masks[x.candidates.view == view], x.views.face[view] >= 0]
        assert any(np.array_equal(mask, other) for other in offered)  # type: ignore[arg-type]  # a mask in every view
    value, count = relevance(windows, fits, one, x.views.face.shape)
    each = part_posterior(fits, one)[0]
    assert each.min() - 1e-6 <= value[count > 0].min() <= value.max() <= each.max() + 1e-6


LARGE = {"text_config": {"hidden_size": 768, "intermediate_size": 3072, "num_hidden_layers": 12, "num_attention_heads": 12},
         "vision_config": {"hidden_size": 1024, "intermediate_size": 4096, "num_hidden_layers": 24, "num_attention_heads": 16,
                           "image_size": 336, "patch_size": 14}, "projection_dim": 768}  # fmt: skip
"""ViT-L/14 at 336 px, the published configuration (Radford et al. 2021, table 20)"""


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("models"))


def scored(model: Path, **more: Any) -> PartScores:
    x, few = looked(), slice(0, 12)
    some = replace(x.candidates, view=x.candidates.view[few], masks=x.candidates.masks[few], quality=x.candidates.quality[few])
    params = mask_score.Params("clip", Clip(str(model), **more))
    return mask_score.run(x.mesh, x.views, some, x.told, NONE, params)


def test_chain_from_mesh_to_files(models: Path, tmp_path: Path) -> None:
    """Check that a changed byte of the weights reruns the scorer and nothing before it."""
    clip = Path(shutil.copytree(models / "clip", tmp_path / "clip"))
    sets = ["mask_score.backend=clip", f"mask_score.clip.model={clip}"]
    runner, report = run(tmp_path / "store", sets)
    assert report.ok, report.failures
    found = runner.store.load(content(report, "mask_score"))
    assert found.share.dtype == found.overlap.dtype == np.float32 and found.share.shape == found.overlap.shape
    assert runner.store.load(content(report, "negative_affordance_files")).files
    assert not run(tmp_path / "store", sets)[1].ran
    flip_a_weight(clip / "model.safetensors")
    ran = run(tmp_path / "store", sets)[1].ran.keys()
    assert {"mask_score"} <= ran <= {"mask_score", "negative_affordance_projection", "negative_affordance_files"}


def test_scores_depend_on_weights_and_are_deterministic(models: Path, tmp_path: Path) -> None:
    """Check that the batch size changes the last bits alone, and that `model` may name the parent of `clip/`."""
    found = scored(models / "clip")
    assert found.share.tobytes() == scored(models / "clip").share.tobytes() == scored(models).share.tobytes()
    assert scored(models, batch=3).overlap == pytest.approx(found.overlap, abs=1e-5)
    assert np.abs(scored(save_backbones(tmp_path, seed=4) / "clip").overlap - found.overlap).max() > 1e-4
    assert np.abs(scored(models, dtype="bfloat16").overlap - found.overlap).max() < 0.05


def test_invalid_clip_folders_are_refused(models: Path, tmp_path: Path) -> None:
    """Check another model, a missing tokenizer, a truncated file and a missing folder."""
    mute, cut = (Path(shutil.copytree(models / "clip", tmp_path / name)) for name in ("mute", "cut"))
    (mute / "tokenizer.json").unlink()
    (cut / "model.safetensors").write_bytes((cut / "model.safetensors").read_bytes()[:-500])
    for folder, said in ((models / "sam", "expected the weights of a CLIPModel"), (mute, "expected a tokenizer.json"),
                         (cut, "expected the weights of a CLIPModel"), (tmp_path / "nowhere", "got nothing there")):  # fmt: skip
        with pytest.raises(ValueError, match=said) as caught:
            scored(folder)
        assert "\n" not in str(caught.value)


def test_published_model_size() -> None:
    """Check the published 428 M: 427,944,193 parameters."""
    with torch.device("meta"):
        model = CLIPModel(CLIPConfig(**LARGE))
    count = sum(parameter.numel() for parameter in model.parameters())
    assert count == 427_944_193 and round(count / 1e6) == 428
