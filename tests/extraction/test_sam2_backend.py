"""SAM 2 as a backend of two stages: propagation, weights, and one source through the whole pipeline."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from afford.codecs import CODEC
from afford.extraction.complete.sam2 import complete
from afford.extraction.tracks import BACKGROUND, UNKNOWN, Sam2
from afford.extraction.tracks.sam2 import propagate
from afford.models.frame_masks import full_size
from afford.models.sam2 import load_model, session, track, track_frames
from runner.index import Index
from runner.store import Store
from schemas.masks import Entity, Tracks
from schemas.video import Frames, Inpainted
from tests.helpers.command import Called, Made
from tests.helpers.learned_chain import flip_a_weight
from tests.helpers.tiny_models import save_backbones, save_sam2_video


@pytest.fixture(scope="module")
def sam2_params(tmp_path_factory: pytest.TempPathFactory) -> Sam2:
    folder: Path = save_sam2_video(tmp_path_factory.mktemp("sam2"))
    return Sam2(model=str(folder), device="cpu", dtype="float32", memory_keys=2, cache_frames=4)


def test_key_labels_are_kept(sam2_params: Sam2) -> None:
    """Key frames keep known labels with confidence 1; other frames have valid labels and confidences."""
    rgb = np.random.default_rng(1).integers(0, 255, (4, 32, 48, 3), np.uint8)
    labels = np.zeros((2, 32, 48), np.int16)
    labels[:, 4:20, 4:20], labels[:, 8:28, 28:44], labels[0, 0, 0] = 1, 2, UNKNOWN
    found = propagate(rgb, np.array([0, 3]), labels, 2, sam2_params)
    known = labels != UNKNOWN
    assert np.array_equal(found.labels[[0, 3]][known], labels[known])
    assert found.labels.min() >= 0 and found.labels.max() <= 2
    assert (found.confidence[:, [0, 3]] == 1).all() and ((found.confidence >= 0) & (found.confidence <= 1)).all()


def test_an_object_out_of_sight_stays_empty(tmp_path: Path) -> None:
    """Frames without a visible mask stay empty; other frames have a confidence between 0 and 1."""
    folder = save_sam2_video(tmp_path)
    t, h, w = 3, 32, 48
    rgb = np.random.default_rng(2).integers(0, 255, (t, h, w, 3), np.uint8)
    frame, time = np.arange(1, t + 1), np.arange(t, dtype=np.int64)
    masks = np.zeros((1, t, h, w), bool)
    masks[0, :2, 8:24, 10:30] = True
    one = np.ones((1, t))
    tracks = Tracks("c", (Entity("mug", "mug", 13, "object", ""),), frame, masks, one.astype(np.float32), one.astype(np.uint8),
                    one.astype(np.int64), one.astype(np.int32), -np.ones((2, t), np.int16), -np.ones((2, t), np.int32))  # fmt: skip
    empty = np.zeros((t, h, w))
    inpainted = Inpainted("c", frame, rgb, empty > 0, empty.astype(np.uint8), empty.astype(np.uint8))
    params = SimpleNamespace(model=str(folder), device="cpu", dtype="float32")
    found = complete(Frames("c", frame, time, rgb), tracks, inpainted, 0, params)
    assert not found.masks[2].any() and found.confidence[2] == 0
    assert ((found.confidence >= 0) & (found.confidence <= 1)).all()


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
    for trace in Index(mine.store).all():
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
    """The logits in the middle between two key frames are the mean of both passes."""
    rgb = np.random.default_rng(1).integers(0, 255, (5, 48, 80, 3), np.uint8)
    prompts = {at: np.zeros((1, 48, 80), bool) for at in (0, 4)}
    prompts[0][0, 5:25, 5:25], prompts[4][0, 20:40, 50:70] = True, True
    net = load_model(str(model))
    made = session(net, rgb, prompts, 8)
    ways = [{seen.at: seen.logits for seen in track_frames(net, rgb, prompts, order, within=made)}
            for order in (range(5), range(4, -1, -1))]
    assert (ways[0][2] - ways[1][2]).abs().max() > 0
    labels = np.stack([prompts[0][0], prompts[4][0]]).astype(np.int16)
    mixed = propagate(rgb, np.array([0, 4]), labels, 1, params(model)).labels[2]
    mean = (ways[0][2].half().float() + ways[1][2]) / 2
    wanted = np.where(full_size(mean, (48, 80))[0] > 0, 1, BACKGROUND)
    assert (mixed == wanted).mean() > 0.999


def test_memory_is_bounded(model: Path) -> None:
    """Distant frames keep their prompts only, and the feature cache has the requested size."""
    rgb = np.random.default_rng(2).integers(0, 255, (24, 32, 32, 3), np.uint8)
    prompts = {0: np.ones((1, 32, 32), bool)}
    net = load_model(str(model))
    made = session(net, rgb, prompts, 3)
    far = max(net.config.num_maskmem, net.config.max_object_pointers_in_encoder)
    for seen in track_frames(net, rgb, prompts, range(24), within=made):
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
            "from afford.surface.describe import chat\nfrom afford.surface.score import clip\n"
            "from afford.models.sam2 import load_model\n"
            f"load_model({str(model)!r})\nprint('torchvision' in sys.modules)")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
