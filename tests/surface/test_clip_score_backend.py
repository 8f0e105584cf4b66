"""CLIP as a scorer of parts: an object through the whole chain, and what becomes of it when the weights change."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from transformers import CLIPConfig, CLIPModel

from afford.surface.score import Clip
from schemas.files import FileTree
from schemas.surface import PartScores
from stages.surface import mask_score
from tests.helpers.learned_chain import content, flip_a_weight, run
from tests.helpers.made_objects import looked
from tests.helpers.tiny_models import save_backbones

NONE = FileTree("none", ())
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


def test_one_object_goes_through_the_whole_chain(models: Path, tmp_path: Path) -> None:
    """From the mesh to files of its negative surface; a byte of the weights reruns the scorer, and nothing before it."""
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


def test_other_weights_other_scores_and_the_same_bytes_twice(models: Path, tmp_path: Path) -> None:
    """The size of a pass is felt in the last bits alone; `model` may name the folder above `clip/` as well."""
    found = scored(models / "clip")
    assert found.share.tobytes() == scored(models / "clip").share.tobytes() == scored(models).share.tobytes()
    assert scored(models, batch=3).overlap == pytest.approx(found.overlap, abs=1e-5)
    assert np.abs(scored(save_backbones(tmp_path, seed=4) / "clip").overlap - found.overlap).max() > 1e-4
    assert np.abs(scored(models, dtype="bfloat16").overlap - found.overlap).max() < 0.05


def test_what_is_no_clip_is_refused_in_a_sentence(models: Path, tmp_path: Path) -> None:
    """Another model, no tokenizer, a file cut short, nothing there."""
    mute, cut = (Path(shutil.copytree(models / "clip", tmp_path / name)) for name in ("mute", "cut"))
    (mute / "tokenizer.json").unlink()
    (cut / "model.safetensors").write_bytes((cut / "model.safetensors").read_bytes()[:-500])
    for folder, said in ((models / "sam", "expected the weights of a CLIPModel"), (mute, "expected a tokenizer.json"),
                         (cut, "expected the weights of a CLIPModel"), (tmp_path / "nowhere", "got nothing there")):  # fmt: skip
        with pytest.raises(ValueError, match=said) as caught:
            scored(folder)
        assert "\n" not in str(caught.value)


def test_the_published_size() -> None:
    """427,944,193 parameters, which is the published 428 M."""
    with torch.device("meta"):
        model = CLIPModel(CLIPConfig(**LARGE))
    count = sum(parameter.numel() for parameter in model.parameters())
    assert count == 427_944_193 and round(count / 1e6) == 428
