"""Segment Anything as a proposer: the whole chain, and dependence on the weights."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from afford.surface.proposals import Sam
from stages.surface import mask_propose
from tests.helpers.learned_chain import content, flip_a_weight, run
from tests.helpers.made_objects import looked
from tests.helpers.tiny_models import save_backbones, save_sam2_video


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("models"))


def params(folder: Path, **more: Any) -> mask_propose.Params:
    """Settings that accept every predicted mask."""
    return mask_propose.Params("sam", sam=Sam(str(folder), grid=6, least_iou=-9.0, least_stability=0.0, least_px=5, **more))


def test_chain_from_mesh_to_files(models: Path, tmp_path: Path) -> None:
    """Check that a changed byte of SAM's weights reruns the proposer and not the views."""
    sam = Path(shutil.copytree(models / "sam", tmp_path / "sam"))
    sets = ["mask_propose.backend=sam", f"mask_propose.sam.model={sam}", "mask_propose.sam.grid=6", "mask_propose.sam.least_iou=-9",
            "mask_propose.sam.least_stability=0", "mask_propose.sam.least_px=5", "mask_score.backend=clip",
            f"mask_score.clip.model={models / 'clip'}"]  # fmt: skip
    runner, report = run(tmp_path / "store", sets)
    assert report.ok, report.failures
    masks = runner.store.load(content(report, "mask_propose"))
    assert masks.masks.dtype == bool and masks.masks.shape[1:] == (96, 96) and len(masks.masks) == len(masks.view) > 0
    assert not run(tmp_path / "store", sets)[1].ran
    flip_a_weight(sam / "model.safetensors")
    assert {"mask_propose"} <= run(tmp_path / "store", sets)[1].ran.keys() <= {
        "mask_propose", "mask_score", "negative_affordance_projection", "negative_affordance_files"}  # fmt: skip


def test_masks_depend_on_weights_and_are_deterministic(models: Path, tmp_path: Path) -> None:
    """Check that the batch size changes nothing."""
    x = looked()
    found = [mask_propose.run(x.mesh, x.views, params(models / "sam", batch=batch)) for batch in (64, 64, 5)]
    assert found[0].masks.tobytes() == found[1].masks.tobytes() and found[0].quality.tobytes() == found[1].quality.tobytes()
    assert abs(len(found[0].masks) - len(found[2].masks)) <= 1
    other = mask_propose.run(x.mesh, x.views, params(save_backbones(tmp_path, seed=5) / "sam"))
    assert found[0].masks.shape != other.masks.shape or not np.array_equal(found[0].masks, other.masks)


def test_invalid_sam_folders_are_refused(models: Path, tmp_path: Path) -> None:
    """Check another model, a truncated file and a missing config."""
    cut = Path(shutil.copytree(models / "sam", tmp_path / "cut"))
    (cut / "model.safetensors").write_bytes((cut / "model.safetensors").read_bytes()[:5000])
    bare = Path(shutil.copytree(models / "sam", tmp_path / "bare"))
    (bare / "config.json").unlink()
    x = looked()
    for folder, said in ((cut, "expected the weights of a SamModel"), (bare, "expected config.json of a SamModel"),
                         (save_sam2_video(tmp_path / "sam2"), "expected the weights of a SamModel")):  # fmt: skip
        with pytest.raises(ValueError, match=said) as caught:
            mask_propose.run(x.mesh, x.views, params(folder))
        assert "\n" not in str(caught.value)
