"""`predict --model sor3d`: what is written, what the model is shown, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from safetensors.numpy import load_file

from afford.common.errors import SourceError
from afford.common.video.frames import decode_video
from afford.models import shipped
from afford.rgbd import footage
from afford.rgbd.footage import Lens, Sampling
from afford.rgbd.model.checkpoint import FORMAT
from afford.rgbd.model.predictor import Predictor, first_frames
from afford.twohands.model import model_folder
from schemas.interaction import AFFORDANCES, BACKGROUND
from stages.rgbd import scene_flow
from tests.helpers import tiny_asked
from tests.helpers.command import Called, call
from tests.helpers.tiny_sor3d import SIZE, frames, last_frame, write_frames, write_model, write_video

FILES = {"label.png", "overlay.png", "attention.png", "probabilities.safetensors", "prediction.json"}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a two-hand model was published, and before it one of sequences."""
    folder = tmp_path_factory.mktemp("store")
    write_model(folder / "models" / "sor3d" / "model")
    tiny_asked.write_model(folder / "models" / "small" / "model")
    return folder


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("shown") / "slide")


def predict(store: Path, source: Path, out: Path, *words: str | Path, model: str | Path = "sor3d") -> Called:
    return call("predict", source, "--model", model, "--out", out, "--store", store, "--json", *words)


def said(folder: Path) -> dict:
    return json.loads((folder / "prediction.json").read_text())


def test_prediction_files_of_a_sequence(store: Path, shown: Path, tmp_path: Path) -> None:
    """Same values as the Python API; labels at the picture's size, background outside the square; numbers agree with pictures."""
    done = predict(store, shown / "rgb", tmp_path / "out", "--depth", shown / "depth", "--focal-px", "45", "--threshold", "0.2")
    assert done.code == 0 and [one["folder"] for one in done.json["predictions"]] == ["rgb"], done.err
    folder = tmp_path / "out" / "rgb"
    assert {path.name for path in folder.iterdir()} == FILES
    told, label = said(folder), cv2.imread(str(folder / "label.png"), cv2.IMREAD_UNCHANGED)
    assert label.shape == (40, 56) and (label[:, :8] == BACKGROUND).all() and (label[:, 48:] == BACKGROUND).all()
    assert (told["mode"], told["frames"], told["depth"], told["flow"]) == ("video", 4, True, "3d")
    assert told["square_px"] == [8, 0, 48, 40]
    predictor = Predictor(store / "models" / "sor3d" / "model")
    seen = footage.read_footage(shown / "rgb", shown / "depth", Lens(focal_px=45), Sampling(), SIZE)
    found = predictor.predict(predictor.inputs_of_clip(seen.clip, scene_flow.run(seen.clip, scene_flow.Params())))
    kept = load_file(folder / "probabilities.safetensors")
    assert np.array_equal(kept["probability"], found.probability) and kept["probability"].shape == (10, SIZE, SIZE)
    assert np.array_equal(label[:, 8:48], cv2.resize(found.label, (40, 40), interpolation=cv2.INTER_NEAREST))
    assert told["action"]["label"] == AFFORDANCES[found.action.argmax()]
    for n, name in enumerate(AFFORDANCES):
        assert told["affordances"][name]["area_px"] == (label == n).sum()
        assert told["action"]["probabilities"][name] == pytest.approx(found.action[n], abs=1e-6)
    assert kept["attention"].sum() == pytest.approx(1, abs=1e-5) and told["model"]["digest"] == done.json["model"]["digest"]


def test_prediction_without_depth_warns(store: Path, shown: Path, tmp_path: Path) -> None:
    """One line; for a model with motion in space nothing moves then."""
    done = predict(store, shown / "rgb", tmp_path / "out")
    assert done.code == 0 and "no depth" in done.err and said(tmp_path / "out" / "rgb")["flow"] == "none"
    flat = write_model(tmp_path / "flat", "rgb_attention_flow2d")
    done = predict(store, shown / "rgb", tmp_path / "flow", model=flat)
    assert done.code == 0 and "no depth" not in done.err and said(tmp_path / "flow" / "rgb")["flow"] == "2d"


def test_picture_is_a_sequence_of_one_frame(store: Path, shown: Path, tmp_path: Path) -> None:
    """The last frame as a file, with depth as metres in .npy, gives the prediction of static mode."""
    depth = tmp_path / "far.npy"
    np.save(depth, frames()[1][-1])
    done = predict(store, shown / "rgb" / "0004.png", tmp_path / "out", "--depth", depth)
    told = said(tmp_path / "out" / "0004")
    assert done.code == 0 and (told["mode"], told["frames"], told["flow"]) == ("picture", 1, "none")
    predictor = Predictor(store / "models" / "sor3d" / "model")
    whole = footage.read_footage(shown / "rgb", shown / "depth", Lens(), Sampling(), SIZE)
    found = predictor.predict(last_frame(predictor.inputs_of_clip(whole.clip, None)))
    kept = load_file(tmp_path / "out" / "0004" / "probabilities.safetensors")["probability"]
    assert np.allclose(kept, found.probability, atol=1e-6)


def test_last_frame_of_a_video_is_labelled(store: Path, tmp_path: Path) -> None:
    """23 frames at 20 / s, sampled at 10 / s: 12 of them, or the last 5; the last one is the video's last."""
    video = write_video(tmp_path / "slide.mp4")
    for words, count in (("20", 12), ("5", 5)):
        done = predict(store, video, tmp_path / words, "--frames", words)
        told = said(tmp_path / words / "slide")
        assert done.code == 0 and (told["frames"], told["frame"]) == (count, 23), done.err
    seen = footage.read_footage(video, None, Lens(), Sampling(10.0, 3), SIZE)
    _, _, images = decode_video(video, 1, 23, None, (96, 40))
    shown = [cv2.resize(images[n][:, 28:68], (SIZE, SIZE), interpolation=cv2.INTER_AREA) for n in (18, 20, 22)]
    assert np.array_equal(seen.clip.rgb, np.stack(shown))


def test_frames_are_predicted_as_the_last_one(store: Path, shown: Path) -> None:
    """The prediction of frame i is that of the sequence that ends there."""
    predictor = Predictor(store / "models" / "sor3d" / "model")
    clip = footage.read_footage(shown / "rgb", shown / "depth", Lens(), Sampling(), SIZE).clip
    seen = predictor.inputs_of_clip(clip, scene_flow.run(clip, scene_flow.Params()))
    every = predictor.every_frame(seen)
    assert len(every) == 4 and np.array_equal(every[-1].probability, predictor.predict(seen).probability)
    assert np.array_equal(every[1].action, predictor.predict(first_frames(seen, 2)).action)
    assert not np.allclose(every[0].action, every[-1].action, atol=1e-6)


def test_frames_without_zeros_in_front_keep_their_order(tmp_path: Path) -> None:
    """Colours and depth of 1.png to 12.png are those of 0001.png to 0012.png."""
    padded, plain = write_frames(tmp_path / "padded", 12), write_frames(tmp_path / "plain", 12)
    for path in [*plain.glob("rgb/0*.png"), *plain.glob("depth/*.png")]:
        path.rename(path.with_stem(str(int(path.stem))))
    wanted, found = (footage.read_footage(root / "rgb", root / "depth", Lens(), Sampling(), SIZE) for root in (padded, plain))
    assert np.array_equal(found.clip.rgb, wanted.clip.rgb) and np.array_equal(found.clip.depth_m, wanted.clip.depth_m)
    assert np.array_equal(found.rgb, wanted.rgb)


def test_confidence_is_a_threshold(store: Path, shown: Path) -> None:
    """Pixels show their best affordance at 0, none at 0.999; between, exactly those above it."""
    predictor = Predictor(store / "models" / "sor3d" / "model")
    clip = footage.read_footage(shown / "rgb", None, Lens(), Sampling(), SIZE).clip
    found = predictor.predict(predictor.inputs_of_clip(clip, None))
    assert (found.confident(0.0) != BACKGROUND).all() and (found.confident(0.999) == BACKGROUND).all()
    middle = float(np.median(found.probability[:BACKGROUND].max(0)))
    assert np.array_equal(found.confident(middle) != BACKGROUND, found.probability[:BACKGROUND].max(0) > middle)
    assert np.allclose(found.probability.sum(0), 1, atol=1e-5) and found.action.sum() == pytest.approx(1, abs=1e-5)


def test_model_option_selects_the_latest_of_its_kind(store: Path) -> None:
    """The model published last, of the requested kind."""
    assert model_folder.latest_model(store / "models", FORMAT) == store / "models" / "sor3d"
    assert model_folder.latest_model(store / "models") == store / "models" / "small"


def test_camera_of_the_square(shown: Path) -> None:
    """A point projects to the same place of the scene before and after cropping and resizing."""
    seen = footage.read_footage(shown / "rgb", shown / "depth", Lens(focal_px=50), Sampling(), SIZE)
    u, v = 20.0, 11.0
    ray = np.array([(u - 27.5) / 50, (v - 19.5) / 50, 1])
    x, y, _ = seen.clip.K @ ray
    assert (x, y) == pytest.approx(((u - 8 + 0.5) * SIZE / 40 - 0.5, (v + 0.5) * SIZE / 40 - 0.5))


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("pour tea",), "model sor3d takes no task"),
        (("--hands", "left"), "--hands: model sor3d does not have this option"),
        (("--quick",), "--quick: model sor3d does not have this option"),
        (("--dtype", "float16"), "--dtype: model sor3d does not have this option"),
        (("--threshold", "1"), "expected a probability"),
        (("--frames", "0"), "--frames 0"),
        (("--focal-px", "-3"), "--focal-px -3"),
        (("--depth", "nowhere"), "nowhere: no such file or folder"),
        (("--device", "gpu"), "unknown --device 'gpu'"),
        (("--store", "nowhere"), "no model of `run sor3d` there"),
    ],
)
def test_a_wrong_call_is_refused(words: tuple[str, ...], hint: str, store: Path, shown: Path, tmp_path: Path,
                                 monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Exit 2, one sentence, nothing written."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    refused = predict(store, shown / "rgb", tmp_path / "out", *words)
    assert refused.code == 2 and hint in refused.words.replace("│ ", "") and "Traceback" not in refused.err
    assert not (tmp_path / "out").exists()


def test_depth_is_refused_by_models_without_depth(store: Path, shown: Path, tmp_path: Path) -> None:
    """The two-hand model refuses it."""
    refused = call("predict", shown / "rgb" / "0001.png", "pour", "--out", tmp_path / "out", "--store", store, "--depth", shown)
    assert refused.code == 2 and "does not use depth" in refused.err


def test_unreadable_input_is_a_failure(store: Path, shown: Path, tmp_path: Path) -> None:
    """Exit 1 and the file's name: no pictures, too few depths, depth of another size, no video."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "film.mp4").write_bytes(b"no video")
    np.save(tmp_path / "small.npy", np.ones((4, 4), np.float32))
    for source, words, hint in (
        (tmp_path / "empty", (), "expected frames of one sequence"),
        (shown / "rgb", ("--depth", tmp_path / "small.npy"), "expected 4 depth pictures"),
        (shown / "rgb" / "0001.png", ("--depth", tmp_path / "small.npy"), "expected depth of 56 x 40 px"),
        (tmp_path / "film.mp4", (), "film.mp4: expected a video"),
    ):
        done = predict(store, source, tmp_path / "out", *words)
        assert done.code == 1 and hint in done.json["failures"][0]["message"] and not done.json["predictions"]
    with pytest.raises(SourceError, match="one size"):
        odd = write_frames(tmp_path / "odd")
        cv2.imwrite(str(odd / "rgb" / "0002.png"), np.zeros((8, 8, 3), np.uint8))
        footage.read_footage(odd / "rgb", None, Lens(), Sampling(), SIZE)
