"""The verb `predict` and its leafs: what is written, what is refused, and what one bad picture does to the others: nothing."""

from __future__ import annotations

import json
import os
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from afford.common import image_files
from afford.common.bounded import TooLargeError
from afford.common.drawing import overlay
from afford.common.errors import SourceError
from afford.common.image_files import Picture, decode_image
from afford.common.palette import HANDS
from afford.common.video.frames import decode_video, every_nth
from afford.common.video.inputs import find
from afford.models import shipped
from afford.twohands.inference import Question, ask
from afford.twohands.model import model_folder
from afford.twohands.model.predictor import Predictor
from afford.twohands.prediction_files import record
from benchmarks.shipped.ship import ship
from schemas.affordance import TAXONOMY
from tests.helpers import tiny_asked
from tests.helpers.command import Called, call
from tests.helpers.tiny_asked import TASK, write_picture

FILES = {"left.png", "right.png", "overlay.png", "prediction.json"}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a model was published."""
    folder = tmp_path_factory.mktemp("store")
    tiny_asked.write_model(folder / "models" / "small" / "model")
    return folder


@pytest.fixture(scope="module")
def model(store: Path) -> Path:
    return store / "models" / "small" / "model"


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """23 frames, each a little brighter than the one before."""
    path = tmp_path_factory.mktemp("video") / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 90, 60, "yuv420p"
        for n in range(23):
            image = np.full((60, 90, 3), 20 + 9 * n, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


def predict(store: Path, image: Path, out: Path, *words: str, task: str = TASK) -> Called:
    return call("predict", image, task, "--out", out, "--store", store, "--json", *words)


def mask(path: Path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None and found.ndim == 2 and set(np.unique(found)) <= {0, 255}, path
    return found > 0


# -- what is written ---------------------------------------------------------------------------------------------------


def test_a_picture_gives_masks_an_overlay_and_an_object(store: Path, model: Path, tmp_path: Path) -> None:
    """The masks are those of the Python API, at the picture's own size; the object says the same in numbers."""
    image = write_picture(tmp_path / "kettle.png")
    done = predict(store, image, tmp_path / "out", "--hands", "both")
    assert done.code == 0 and len(done.out.splitlines()) == 1
    folder = tmp_path / "out" / "kettle"
    assert {path.name for path in folder.iterdir()} == FILES and not list((tmp_path / "out").glob(".*"))
    expected = Predictor(model).predict(tiny_asked.picture(), TASK, "both")
    said = json.loads((folder / "prediction.json").read_text())
    for n, side in enumerate(("left", "right")):
        found = mask(folder / f"{side}.png")
        assert np.array_equal(found, expected.mask(side)) and 0 < found.mean() < 1
        assert said[side]["selected"] and said[side]["best"] == expected.score[n].argmax()
        assert said[side]["area_share"] == pytest.approx(found.mean(), abs=1e-6)
        assert [h["score"] for h in said[side]["hypotheses"]] == pytest.approx(expected.score[n].tolist(), abs=1e-5)
    assert tuple(said["taxonomy"]["probabilities"]) == TAXONOMY
    assert said["taxonomy"]["label"] == TAXONOMY[expected.taxonomy.argmax()]
    assert said["task"] == TASK and said["threshold"] == pytest.approx(expected.threshold) and said["hands_asked"] == "both"
    assert said["timing_ms"]["cpu"] > 0 and said["timing_ms"]["wall"] > 0 and (said["width_px"], said["height_px"]) == (90, 60)
    assert said["model"] == {"name": "small", "digest": model_folder.find_model(model).digest} == done.json["model"]


def test_quick_is_one_look_without_the_mirror_image(store: Path, model: Path, tmp_path: Path) -> None:
    image, predictor = write_picture(tmp_path / "kettle.png"), Predictor(model, mirror=False)
    done = predict(store, image, tmp_path / "out", "--hands", "both", "--quick")
    assert done.code == 0 and done.json["quick"]
    assert json.loads((tmp_path / "out" / "kettle" / "prediction.json").read_text())["looks"] == 1
    expected = predictor.predict(tiny_asked.picture(), TASK, "both", looks=1)
    slow = Predictor(model).predict(tiny_asked.picture(), TASK, "both")
    for n, side in enumerate(("left", "right")):
        assert np.array_equal(mask(tmp_path / "out" / "kettle" / f"{side}.png"), expected.mask(n))
    assert not np.array_equal(expected.probability, slow.probability)


def test_hands_and_threshold_are_the_users(store: Path, tmp_path: Path) -> None:
    """An idle hand's mask is empty, and a higher threshold gives a smaller region."""
    image = write_picture(tmp_path / "kettle.png")
    areas = {}
    for threshold in ("0.0", "0.999"):
        out = tmp_path / threshold
        assert predict(store, image, out, "--hands", "left", "--threshold", threshold).code == 0
        assert not mask(out / "kettle" / "right.png").any()
        areas[threshold] = mask(out / "kettle" / "left.png").mean()
        said = json.loads((out / "kettle" / "prediction.json").read_text())
        assert said["hands"] == ["left"] and not said["right"]["selected"] and said["right"]["area_share"] == 0
    assert areas["0.0"] == 1 and areas["0.999"] == 0


def test_hypotheses_are_written_on_request(store: Path, tmp_path: Path) -> None:
    """Three per hand, one of which is the hand's mask; boxes in the object fit them."""
    write_picture(tmp_path / "kettle.png")
    predict(store, tmp_path / "kettle.png", tmp_path / "out", "--hands", "both", "--all-hypotheses")
    folder = tmp_path / "out" / "kettle"
    said = json.loads((folder / "prediction.json").read_text())
    for side in ("left", "right"):
        found = [mask(folder / "hypotheses" / f"{side}_{n}.png") for n in range(3)]
        assert np.array_equal(found[said[side]["best"]], mask(folder / f"{side}.png"))
        for one, told in zip(found, said[side]["hypotheses"], strict=True):
            if told["box_px"] is None:
                assert not one.any()
                continue
            left, top, right, bottom = told["box_px"]
            assert one[top:bottom, left:right].sum() == one.sum() > 0
            assert one[top].any() and one[bottom - 1].any() and one[:, left].any() and one[:, right - 1].any()


def test_one_bad_picture_does_not_stop_the_others(store: Path, tmp_path: Path) -> None:
    """A folder at any depth, sorted; exit 1, and each failure is one sentence with the file's name."""
    source = tmp_path / "in"
    write_picture(source / "a.png"), write_picture(source / "deep" / "b.jpg")
    (source / "bad.jpg").write_text("no image"), (source / "empty.png").touch(), (source / "notes.txt").write_text("not looked at")
    done = predict(store, source, tmp_path / "out")
    assert done.code == 1 and [one["folder"] for one in done.json["predictions"]] == ["a", "deep/b"]
    assert [Path(one["source"]).name for one in done.json["failures"]] == ["bad.jpg", "empty.png"]
    for failure in done.json["failures"]:
        assert failure["source"] in failure["message"] and "expected an image" in failure["message"]
        assert failure["message"] in done.words and "Traceback" not in done.err
    index = json.loads((tmp_path / "out" / "predictions.json").read_text())
    assert index["predictions"] == done.json["predictions"] and index["failures"] == done.json["failures"]


def test_a_picture_of_one_pixel_is_a_picture(store: Path, tmp_path: Path) -> None:
    """Alone, and beside another one."""
    write_picture(tmp_path / "in" / "a.png", np.full((1, 1, 3), 100, np.uint8)), write_picture(tmp_path / "in" / "b.png")
    assert predict(store, tmp_path / "in" / "a.png", tmp_path / "one", task="cut").code == 0
    assert mask(tmp_path / "one" / "a" / "left.png").shape == (1, 1)
    done = predict(store, tmp_path / "in", tmp_path / "out", "--batch", "2", task="cut")
    assert done.code == 0 and [one["folder"] for one in done.json["predictions"]] == ["a", "b"]


def test_a_picture_on_which_the_model_breaks_stops_no_other(store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture is refused in one sentence with the file and the error; the others of its batch are predicted."""
    for n in range(3):
        write_picture(tmp_path / "in" / f"{n}.png", tiny_asked.picture(60, 90 + n))
    whole = Predictor.predict_batch

    def breaks(self: Predictor, images: list[np.ndarray], *rest: Any) -> Any:
        if any(image.shape[1] == 91 for image in images):
            raise RuntimeError("out of memory")
        return whole(self, images, *rest)

    monkeypatch.setattr(Predictor, "predict_batch", breaks)
    done = predict(store, tmp_path / "in", tmp_path / "out", "--batch", "3")
    assert done.code == 1 and [one["folder"] for one in done.json["predictions"]] == ["0", "2"]
    (failure,) = done.json["failures"]
    assert f"{tmp_path / 'in' / '1.png'}: expected" in failure["message"] and "RuntimeError: out of memory" in failure["message"]


def test_batches_say_the_same(store: Path, tmp_path: Path) -> None:
    """Three pictures of two sizes, one by one or together: masks differ in hardly a pixel."""
    for n, size in enumerate([(60, 90), (120, 80), (60, 90)]):
        write_picture(tmp_path / "in" / f"{n}.png", tiny_asked.picture(*size))
    for batch in ("1", "2"):
        assert predict(store, tmp_path / "in", tmp_path / batch, "--batch", batch, "--hands", "both").code == 0
    for one in sorted((tmp_path / "1").rglob("left.png")):
        other = tmp_path / "2" / one.relative_to(tmp_path / "1")
        assert (mask(one) != mask(other)).mean() < 0.01


def test_a_video_is_sampled_at_every_nth_frame(store: Path, video: Path, tmp_path: Path) -> None:
    """Records have the number, from 1, and the time of the frame."""
    done = predict(store, video, tmp_path / "out", "--every", "10")
    assert done.code == 0 and [one["frame"] for one in done.json["predictions"]] == [1, 11, 21]
    said = json.loads((tmp_path / "out" / "clip" / "frame_0000011" / "prediction.json").read_text())
    assert said["frame"] == 11 and said["time_s"] == pytest.approx(1.0, abs=1e-3) and said["source"] == str(video)


def test_sampled_frames_are_those_that_the_reader_decodes(video: Path) -> None:
    """Same number, time and pixels as `decode_video`."""
    number, time_ns, images = decode_video(video, 1, 23, None, (90, 60))
    sampled = list(every_nth(video, 7))
    assert [one[0] for one in sampled] == [1, 8, 15, 22]
    for n, time_s, rgb in sampled:
        assert number[n - 1] == n and time_s * 1e9 == pytest.approx(time_ns[n - 1]) and np.array_equal(rgb, images[n - 1])


def test_a_file_that_is_not_a_video_is_a_failure(store: Path, tmp_path: Path) -> None:
    """The error names the file; exit 1."""
    (tmp_path / "clip.mp4").write_bytes(b"no video at all")
    done = predict(store, tmp_path / "clip.mp4", tmp_path / "out")
    assert done.code == 1 and "clip.mp4: expected a video" in done.json["failures"][0]["message"] and not done.json["predictions"]


# -- where it is written -----------------------------------------------------------------------------------------------


def test_a_call_goes_on_in_its_own_folder_and_leaves_others_alone(store: Path, tmp_path: Path) -> None:
    """Its own may be written again; a folder with other files is refused, unless --force; theirs are never replaced."""
    image, out, theirs = write_picture(tmp_path / "kettle.png"), tmp_path / "out", tmp_path / "theirs"
    assert predict(store, image, out).code == predict(store, image, out, "--hands", "both").code == 0
    assert json.loads((out / "kettle" / "prediction.json").read_text())["hands_asked"] == "both"
    write_picture(theirs / "kettle" / "photo.png")
    refused = predict(store, image, theirs)
    assert refused.code == 2 and "expected a new or empty folder" in refused.err and not (theirs / "predictions.json").exists()
    forced = predict(store, image, theirs, "--force")
    assert forced.code == 1 and (theirs / "kettle" / "photo.png").exists()
    assert "expected an earlier prediction or nothing, got something else" in forced.json["failures"][0]["message"]


def test_a_full_disk_leaves_what_was_there(store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture whose files cannot be written fails by name; its earlier folder is whole, and nothing half written stays."""

    def full(path: Path, content: object) -> None:
        raise OSError(f"{path}: no space left")

    image, out = write_picture(tmp_path / "kettle.png"), tmp_path / "out"
    predict(store, image, out)
    before = {path: path.read_bytes() for path in (out / "kettle").iterdir()}
    with monkeypatch.context() as patched:
        patched.setattr("afford.twohands.prediction_files.write_verified", full)
        failed = predict(store, image, out)
    assert failed.code == 1 and "no space left" in failed.json["failures"][0]["message"]
    assert {path: path.read_bytes() for path in (out / "kettle").iterdir()} == before and not list(out.glob(".*"))


def test_predictions_are_not_asked_about(store: Path, tmp_path: Path) -> None:
    """A folder that holds an earlier call's masks gives its own pictures alone."""
    write_picture(tmp_path / "in" / "kettle.png")
    for _ in range(2):
        done = predict(store, tmp_path / "in", tmp_path / "in" / "out", "--all-hypotheses")
        assert [one["folder"] for one in done.json["predictions"]] == ["kettle"]


def test_names_never_meet(tmp_path: Path) -> None:
    """Files of one stem, and a file beside a folder of its stem, keep their suffix; links that leave the folder are passed over."""
    root = tmp_path / "in"
    for name in ("a.png", "a.jpg", "b.png", "b/c.png", ".hidden.png"):
        write_picture(root / name)
    os.symlink(write_picture(tmp_path / "outside.png"), root / "link.png")
    assert {source.name for source in find(root)} == {"a.png", "a.jpg", "b.png", "b/c"}


# -- what is refused ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("--hands", "lft"), "did you mean 'left'"),
        (("--threshold", "1.5"), "expected a probability"),
        (("--threshold", "much"), "not a valid float"),
        (("--every", "0"), "--every 0: expected 1 or more"),
        (("--batch", "0"), "--batch 0: expected 1 or more"),
        (("--device", "gpu"), "unknown --device 'gpu'"),
        (("--model", "nowhere"), "expected a trained model"),
        (("--store", "nowhere"), "run `make train` or give --model DIR"),
    ],
)
def test_a_wrong_call_is_refused(words: tuple[str, ...], hint: str, store: Path, tmp_path: Path,
                                 monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Exit 2, one sentence, nothing written."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    refused = predict(store, write_picture(tmp_path / "kettle.png"), tmp_path / "out", *words)
    assert refused.code == 2 and hint in refused.words.replace("│ ", "") and "Traceback" not in refused.err
    assert not (tmp_path / "out").exists()


def test_missing_pictures_or_tasks_are_refused(store: Path, tmp_path: Path) -> None:
    """No file, no picture in a folder, no words; --out that is a file."""
    image = write_picture(tmp_path / "kettle.png")
    (tmp_path / "empty").mkdir()
    none, empty = tmp_path / "none.png", tmp_path / "empty"
    for source, out, task, hint in ((none, "out", TASK, "nothing there"), (empty, "out", TASK, "got no such file"),
                                    (image, "out", "  ", "TASK"), (image, "kettle.png", TASK, "expected a folder, got a file")):
        refused = predict(store, source, tmp_path / out, task=task)
        assert refused.code == 2 and hint in refused.err and not (tmp_path / "out").exists()


def test_a_damaged_model_is_refused(model: Path, tmp_path: Path) -> None:
    """The error names the file."""
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "config.json").write_bytes((model / "config.json").read_bytes())
    (tmp_path / "model" / "model.safetensors").write_bytes(b"nothing")
    refused = predict(tmp_path, write_picture(tmp_path / "kettle.png"), tmp_path / "out", "--model", str(tmp_path / "model"))
    assert refused.code == 2 and "model.safetensors" in refused.err


def test_the_model_published_last_answers(model: Path, tmp_path: Path) -> None:
    """Hidden folders, which are half published, do not count."""
    for n, name in enumerate(("old", "new", ".partial")):
        place = tmp_path / "models" / name / "model"
        place.mkdir(parents=True)
        (place / "config.json").write_bytes((model / "config.json").read_bytes())
        os.utime(place.parent, (1000 + n, 1000 + n))
    assert model_folder.latest_model(tmp_path / "models") == tmp_path / "models" / "new"
    assert model_folder.latest_model(tmp_path / "none") is None


def test_the_shipped_model_answers_where_none_was_trained(model: Path, store: Path, tmp_path: Path,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """A trained model comes first; a damaged shipped one is refused."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    ship(model, tmp_path / "weights" / shipped.TWO_HANDS, "# Two hands", {"stages": {}})
    image = write_picture(tmp_path / "kettle.png")
    used = {name: predict(where, image, tmp_path / name, "--json").json["model"]["name"]
            for name, where in (("trained", store), ("none", tmp_path / "empty"))}  # fmt: skip
    assert used["none"] == shipped.TWO_HANDS and used["trained"] != shipped.TWO_HANDS
    (tmp_path / "weights" / shipped.TWO_HANDS / "config.json").write_text("{}")
    refused = predict(tmp_path / "empty", image, tmp_path / "out")
    assert refused.code == 2 and "git checkout weights" in refused.err and "Traceback" not in refused.err


# -- pictures ----------------------------------------------------------------------------------------------------------


def test_a_picture_is_turned_as_its_file_says(tmp_path: Path) -> None:
    """EXIF orientation 6: stored lying, shown upright."""
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(tiny_asked.picture(60, 90)).save(tmp_path / "phone.jpg", exif=exif)
    assert image_files.read_image(tmp_path / "phone.jpg").shape == (90, 60, 3)


@pytest.mark.parametrize("mode", ["L", "RGBA", "P", "I;16", "1"])
def test_any_kind_of_pixels_becomes_rgb(mode: str, tmp_path: Path) -> None:
    """Grey, transparent, palette, 16 bit, black and white."""
    grey = Image.fromarray(tiny_asked.picture()[..., 0])
    made = Image.fromarray(np.asarray(grey).astype(np.uint16) * 257) if mode == "I;16" else grey.convert(mode)
    made.save(tmp_path / "one.png")
    found = image_files.read_image(tmp_path / "one.png")
    assert found.shape == (60, 90, 3) and found.dtype == np.uint8
    assert mode == "1" or np.abs(found[..., 0].astype(int) - np.asarray(grey)).max() <= 1


def test_large_pictures_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    """The header is checked; a bomb of 10^10 pixels is refused too."""
    data = write_picture(tmp_path / "one.png").read_bytes()
    with pytest.raises(TooLargeError, match=r"at most 0\.001 megapixels, got 90 x 60"):
        decode_image(data, "one.png", 1000)
    header = data[12:16] + (100_000).to_bytes(4, "big") * 2 + data[24:29]
    bomb = data[:12] + header + zlib.crc32(header).to_bytes(4, "big") + data[33:]
    with pytest.raises(TooLargeError):
        decode_image(bomb, "bomb.png")


def test_a_cut_file_is_refused(tmp_path: Path) -> None:
    """A header without its picture."""
    data = write_picture(tmp_path / "one.png").read_bytes()
    with pytest.raises(SourceError, match=r"one\.png: expected an image"):
        decode_image(data[:40], "one.png")


# -- overlay and object ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(60, 90), (480, 854), (40, 700)])
def test_the_overlay_is_coloured_inside_the_regions_alone(size: tuple[int, int], model: Path) -> None:
    """Pixels far from a region are the picture's; inside they tend to the hand's colour; the legend lies below."""
    grey = np.full((*size, 3), 128, np.uint8)
    found = Predictor(model).predict(grey, TASK, "left")
    region = np.zeros((2, 3, *size), np.float32)
    region[:, :, size[0] // 4 : size[0] // 2, size[1] // 4 : size[1] // 2] = 1
    drawn = overlay(grey, replace(found, probability=region))
    scale = max(1.0, 640 / size[1])
    height = round(size[0] * scale)
    assert drawn.shape[1] == max(size[1], 640) and drawn.shape[0] > height
    row, column = round(size[0] * 3 / 8 * scale), round(size[1] * 3 / 8 * scale)
    expected = 0.55 * 128 + 0.45 * np.array(HANDS["left"])
    assert np.abs(drawn[row, column].astype(float) - expected).max() <= 1
    assert (drawn[: height // 8] == 128).all() and (drawn[height * 3 // 4 : height] == 128).all()


def test_the_legend_tells_any_task(model: Path) -> None:
    """Long ones take more lines; a word without end and letters outside ASCII are drawn too."""
    found = Predictor(model).predict(tiny_asked.picture(), TASK)
    heights = [overlay(tiny_asked.picture(), replace(found, task=task)).shape[0] for task in
               ("cut", "cut " * 60, "x" * 400, "verser le thé, налить чай")]
    assert heights[1] > heights[0] == heights[2] == heights[3]


def test_the_object_is_strict_json(model: Path) -> None:
    """No NaN, no numpy; a frame of a video says which."""
    shot = Picture("clip/frame_0000011", "clip.mp4", tiny_asked.picture(), 11, 1.0)
    answer = ask(Predictor(model), [shot], Question(TASK, threshold=0.9999))[0]
    said = json.loads(json.dumps(record(answer, model_folder.find_model(model)), allow_nan=False))
    assert said["frame"] == 11 and said["threshold"] == 0.9999
    assert all(h["box_px"] is None and h["area_share"] == 0 for h in said["left"]["hypotheses"])
