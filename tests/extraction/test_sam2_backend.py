"""SAM 2 as a backend of two stages: propagation, weights, and one source through the whole pipeline."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from afford.codecs import CODEC
from afford.extraction.tracks import BACKGROUND, Sam2
from afford.extraction.tracks.sam2 import propagate
from afford.models.sam2 import follow, full_size, load_model, session, track
from runner.store import Store
from runner.traces import Traces
from tests.helpers.command import Called, Made
from tests.helpers.learned_chain import flip_a_weight
from tests.helpers.tiny_models import save_backbones, save_sam2_video

ROOT = Path(__file__).resolve().parents[2]
UNTOUCHED = {"source_read", "clip_footage", "frame_decode", "narration_labelling"}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_sam2_video(tmp_path_factory.mktemp("sam2") / "tiny")


def dataset(mine: Made, densify: Path, complete: Path | None = None) -> Called:
    """The data set of the tiny source, with SAM 2 where a model is given."""
    words = ["--set", "mask_densify.backend=sam2", "--set", f"mask_densify.sam2.model={densify}"]
    words += ["--set", "affordance_intersect.max_area_px855=1e6"]  # a model that knows nothing takes much
    if complete:
        words += ["--set", "object_completion.backend=sam2", "--set", f"object_completion.sam2.model={complete}"]
    done = mine.run("dataset", *words)
    assert done.code == 0, done.words
    return done


@pytest.mark.slow
def test_pipeline_with_sam2(made: Made, model: Path, tmp_path: Path) -> None:
    """Outputs are valid and cached; a changed byte of a model reruns its stages and their consumers; its path does not matter."""
    mine = made.copy(tmp_path)
    first, second = (Path(shutil.copytree(model, tmp_path / name / "tiny")) for name in ("one", "two"))
    ran = dataset(mine, first, second).json["ran"]
    assert ran["mask_densify"] == ran["object_completion"] == 2 and ran["dataset_pack"] == 1 and not UNTOUCHED & ran.keys()
    for trace in Traces(mine.store).all():
        if trace.stage == "mask_densify" and trace.params["fields"]["backend"] == "sam2":
            tracks = Store(mine.store, CODEC).load(trace.output)
            assert tracks.masks.dtype == bool and tracks.masks.shape[1:] == (19, 96, 160)
            assert (tracks.masks.sum(0) <= 1).all() and np.isfinite(tracks.confidence).all()
            assert trace.params["fields"]["sam2"]["fields"]["model"] == "tiny"
            assert set(trace.inputs) == {"clip", "frames", "weights"}
    moved = shutil.move(first.parent, tmp_path / "elsewhere")
    assert dataset(mine, Path(moved) / "tiny", second).json["ran"] == {}
    flip_a_weight(second / "model.safetensors")
    again = dataset(mine, Path(moved) / "tiny", second).json["ran"]
    assert again["object_completion"] == 2 and not {"mask_densify", "hand_inpaint", *UNTOUCHED} & again.keys()


def stretch(params: Sam2, count: int = 5) -> np.ndarray:
    """Labels of a short random video with key frames at its ends."""
    rgb = np.random.default_rng(0).integers(0, 255, (count, 48, 80, 3), np.uint8)
    labels = np.zeros((2, 48, 80), np.int16)
    labels[:, 10:30, 10:30], labels[1, 10:30, 50:70] = 1, 2
    return propagate(rgb, np.array([0, count - 1]), labels, 2, params).labels


def params(model: Path, **more: Any) -> Sam2:
    return Sam2(str(model), **more)


def test_masks_depend_on_weights_and_are_deterministic(model: Path, tmp_path: Path) -> None:
    """The size of the feature cache does not matter; bfloat16 works."""
    found = stretch(params(model))
    assert found.tobytes() == stretch(params(model)).tobytes() == stretch(params(model, cache_frames=1)).tobytes()
    assert not np.array_equal(found, stretch(params(save_sam2_video(tmp_path, seed=1))))
    assert stretch(params(model, dtype="bfloat16")).shape == found.shape


def test_logits_are_blended_by_nearness(model: Path) -> None:
    """In the middle between two key frames the logits are the mean of both passes."""
    rgb = np.random.default_rng(1).integers(0, 255, (5, 48, 80, 3), np.uint8)
    prompts = {at: np.zeros((1, 48, 80), bool) for at in (0, 4)}
    prompts[0][0, 5:25, 5:25], prompts[4][0, 20:40, 50:70] = True, True
    net = load_model(str(model))
    made = session(net, rgb, prompts, 8)
    ways = [{seen.at: seen.logits for seen in follow(net, rgb, prompts, order, within=made)}
            for order in (range(5), range(4, -1, -1))]
    assert (ways[0][2] - ways[1][2]).abs().max() > 0
    labels = np.stack([prompts[0][0], prompts[4][0]]).astype(np.int16)
    mixed = propagate(rgb, np.array([0, 4]), labels, 1, params(model)).labels[2]
    mean = (ways[0][2].half().float() + ways[1][2]) / 2
    wanted = np.where(full_size(mean, (48, 80))[0] > 0, 1, BACKGROUND)
    assert (mixed == wanted).mean() > 0.999


def test_memory_is_bounded(model: Path) -> None:
    """Only prompts are kept of distant frames, and as many image features as requested."""
    rgb = np.random.default_rng(2).integers(0, 255, (24, 32, 32, 3), np.uint8)
    prompts = {0: np.ones((1, 32, 32), bool)}
    net = load_model(str(model))
    made = session(net, rgb, prompts, 3)
    far = max(net.config.num_maskmem, net.config.max_object_pointers_in_encoder)
    for seen in follow(net, rgb, prompts, range(24), within=made):
        kept = made.output_dict_per_obj[0]["non_cond_frame_outputs"]
        assert all(abs(seen.at - at) <= far for at in kept) and len(made.cache._vision_features) <= 3
    assert set(made.output_dict_per_obj[0]["cond_frame_outputs"]) == {0}


def test_an_empty_prompt_gives_an_empty_mask(model: Path) -> None:
    """An object with an empty mask has no pixel in that frame."""
    rgb = np.random.default_rng(3).integers(0, 255, (2, 32, 32, 3), np.uint8)
    assert (track(load_model(str(model)), rgb, {0: np.zeros((1, 32, 32), bool)})[0, 0] < 0).all()


@pytest.mark.parametrize("how", ["missing", "partial", "cut", "foreign", "text"])
def test_invalid_weights_are_refused(how: str, model: Path, tmp_path: Path) -> None:
    """A missing folder, missing tensors, a truncated file, another model and a text file are each refused in one sentence."""
    folder = Path(shutil.copytree(model, tmp_path / "copy"))
    file, message = folder / "model.safetensors", "expected the weights of a Sam2VideoModel"
    if how == "missing":
        folder, message = tmp_path / "nowhere", "expected a Sam2VideoModel in a local folder, got nothing there"
    elif how == "partial":
        kept = {name: one for name, one in load_file(file).items() if not name.startswith("memory_attention.layers.0.linear")}
        save_file(kept, file, {"format": "pt"})
        message += ", these lack memory_attention.layers.0.linear1.bias"
    elif how == "cut":
        file.write_bytes(file.read_bytes()[:-1000])
    elif how == "foreign":
        folder = save_backbones(tmp_path / "other") / "clip"
    else:
        folder = tmp_path / "sam2.pt"
        folder.write_text("a page that says 404")
        message = r"sam2\.pt: expected a checkpoint or TorchScript as torch 1\.6 and later write them, or safetensors; "
    with pytest.raises(ValueError, match=message) as caught:
        load_model(str(folder))
    assert "\n" not in str(caught.value)


def test_device_and_dtype_are_checked(model: Path) -> None:
    with pytest.raises(ValueError, match="dtype 'float8': expected one of float32, bfloat16, float16"):
        load_model(str(model), "cpu", "float8")
    with pytest.raises(ValueError, match="device"):
        load_model(str(model), "toaster")


@pytest.mark.slow
def test_learned_backends_do_not_import_torchvision(model: Path) -> None:
    """The learned backends load their models without torchvision."""
    code = ("import sys\nfrom afford.surface.proposals import sam\nfrom afford.extraction.complete import sam2\n"
            "from afford.surface.describe import vlm\nfrom afford.surface.score import clip\n"
            "from afford.models.sam2 import load_model\n"
            f"load_model({str(model)!r})\nprint('torchvision' in sys.modules)")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
