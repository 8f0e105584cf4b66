"""SAM 3 as a finder of hands: the published loading code on a tiny random model, alone and as a backend of hand_detect."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from afford.extraction.hands import Sam3
from afford.extraction.hands.sam3 import PHRASES, find
from afford.models.sam3 import concept_probabilities, load_model
from afford.models.weights import weight_files
from stages.extraction import hand_detect
from stages.extraction.hand_detect import Params
from tests.extraction.test_hand_detect import clip_of
from tests.helpers.tiny_models import save_backbones, save_sam3
from tests.helpers.tiny_root import digest
from tests.helpers.toy_clip import toy


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_sam3(tmp_path_factory.mktemp("sam3") / "tiny")


def pictures(count: int = 3) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (count, 48, 80, 3), np.uint8)


def params(model: Path) -> Sam3:
    """Whatever the model says counts."""
    return Sam3(str(model), threshold=0.0)


def test_other_weights_other_answers_and_the_same_bytes_twice(model: Path, tmp_path: Path) -> None:
    """Probabilities of four things for every pixel, whatever a picture is looked at with."""
    found = find(pictures(), params(model))
    assert found.shape == (3, 48, 80, 4) and found.dtype == np.float32 and found.min() >= 0 and found.max() <= 1
    assert found.tobytes() == find(pictures(), params(model)).tobytes()
    assert np.allclose(found[:1], find(pictures(1), params(model)), atol=1e-4)
    assert not np.array_equal(found, find(pictures(), params(save_sam3(tmp_path / "other", seed=5))))


def test_words_matter_and_so_does_the_threshold(model: Path) -> None:
    """Other phrases, other masks; where nothing is sure enough nothing is seen."""
    loaded = load_model(str(model))
    said = concept_probabilities(loaded, pictures(1), PHRASES, 0.0)
    assert len({phrase.tobytes() for phrase in said}) == len(PHRASES)
    assert not concept_probabilities(loaded, pictures(1), PHRASES, 1.0).any()
    assert not find(pictures(1), replace(params(model), threshold=1.0))[..., 2].any()


def test_the_detector_of_the_video_model_is_taken(model: Path, tmp_path: Path) -> None:
    """Published files hold a tracker as well and name the detector first; both are no hindrance."""
    found = Path(shutil.copytree(model, tmp_path / "video"))
    config = json.loads((model / "config.json").read_text())
    (found / "config.json").write_text(json.dumps({"model_type": "sam3_video", "detector_config": config}))
    tensors = load_file(model / "model.safetensors")
    extra = {"tracker_neck.fpn.weight": next(iter(tensors.values())).clone()}
    save_file({f"detector_model.{name}": tensor for name, tensor in tensors.items()} | extra, found / "model.safetensors",
              metadata={"format": "pt"})
    assert np.array_equal(find(pictures(1), params(found)), find(pictures(1), params(model)))


def test_stage_with_sam3(model: Path) -> None:
    """The model is an input of the stage, independent of its path."""
    frames = toy(7).frames
    chosen = Params(backend="sam3", batch=3, sam3=params(Path("elsewhere")))
    found = hand_detect.run(clip_of(frames), frames, chosen, weights=weight_files(str(model), digest)).clip
    assert len(found.key_frames) >= 2


def test_invalid_weights_are_refused(model: Path, tmp_path: Path) -> None:
    """A missing name, another model, a truncated file and a missing tensor are refused in one sentence."""
    cut, less = (Path(shutil.copytree(model, tmp_path / name)) for name in ("cut", "less"))
    (cut / "model.safetensors").write_bytes((cut / "model.safetensors").read_bytes()[:5000])
    tensors = load_file(less / "model.safetensors")
    tensors.pop("text_projection.weight")
    save_file(tensors, less / "model.safetensors", metadata={"format": "pt"})
    cases = ((save_backbones(tmp_path / "models") / "sam", "expected the weights of a Sam3Model"), (cut, "weights of a Sam3Model"),
             (less, "these lack text_projection.weight"))  # fmt: skip
    for folder, said in cases:
        with pytest.raises(ValueError, match=said) as caught:
            find(pictures(1), params(folder))
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="set `model`"):
        find(pictures(1), Sam3())
