"""The whole pipeline on a video without masks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from afford.common.video.frames import write_video
from afford.extraction.hands import RIGHT, TOUCHED, network
from afford.recording.summary import summarise
from commands.origin import origin
from maps.settings import Origin, Settings
from pipeline import build
from runner import Runner, RunReport
from schemas.files import FileTree
from schemas.scene import SceneSpec
from tests.helpers.command import call
from tests.helpers.made_finder import FINDER
from tests.helpers.tiny_root import digest
from tests.helpers.toy_clip import toy

ROOT = Path(__file__).resolve().parents[2]
TRAINING = {"hand_plan", "hand_lessons", "hands_train"}
HAND, CARD = (205, 150, 120), (90, 130, 160)
"""colours of the toy's things"""


def by_colour(pictures: np.ndarray, trained: FileTree) -> np.ndarray:
    """Hand finder that knows the toy's colours, but requires trained files."""
    assert trained.find("model.safetensors")
    smooth = np.stack([cv2.GaussianBlur(picture, (0, 0), 3) for picture in pictures]).astype(np.float32)
    out = np.zeros((*pictures.shape[:3], 4), np.float32)
    for column, colour in ((RIGHT, HAND), (TOUCHED, CARD)):
        out[..., column] = np.abs(smooth - np.array(colour, np.float32)).max(-1) < 35
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video, and nothing else."""
    place = tmp_path_factory.mktemp("bare") / "mine"
    write_video(place / "film.mp4", toy(19).frames.rgb, 14)
    return place


@pytest.fixture
def run(folder: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """Run `dataset` in this process."""
    monkeypatch.setattr(network, "segment", by_colour)

    def made(store: Path, settings: Settings) -> RunReport:
        place, _ = origin("dataset", folder, settings, digest)
        runner = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0)
        return runner.run(build("dataset", place, settings), "dataset")

    return made


def looking(**more: object) -> Settings:
    quick = replace(FINDER.extraction.hand_detect, look_s=0.034, every_s=0.2, backend="network", **more)  # type: ignore[arg-type]  # fields of Params
    return FINDER.with_stages(hand_detect=quick)


def test_a_video_alone_becomes_a_data_set(run, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Samples of a hand that holds something, and recordings of the detections.

    A second run does nothing; another view detects again, without training.
    """
    first = run(tmp_path / "store", looking())
    assert first.ok, first.failures
    assert first.ran.keys() >= TRAINING | {"hand_detect", "record_hand_detect", "dataset_pack"} and first.ran["hands_train"] == 1
    tree = next(d for _, d in first.outputs["dataset_pack"])
    store = Runner(tmp_path / "store", ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0).store
    files = store.load(tree)
    rows = [row for file in files.files if file.name.endswith(".parquet") for row in pq.read_table(file.path).to_pylist()]
    assert rows and {row["narration"] for row in rows} == {"hold object"}
    recorded = store.load(next(d for _, d in first.outputs["clip_record"]))
    topics = {topic.topic: topic.messages for topic in summarise(recorded.files[0].path).topics}
    assert topics["/hand_detect/outlines"] and "/source_read/log" in topics
    assert run(tmp_path / "store", looking()).ran == {}
    turned = run(tmp_path / "store", looking(viewpoint="facing")).ran
    assert turned["hand_detect"] == 1 and not TRAINING & turned.keys()


def test_a_source_with_masks_needs_no_hand_detection() -> None:
    """Its graph has none of these stages; another backend needs no training."""
    spec = SceneSpec("P91_01", "carry", "kitchen", seed=3)
    masked = {node.name for node in build("dataset", Origin("x", specs=(spec,)), Settings()).stages()}
    assert not masked & (TRAINING | {"hand_detect", "record_hand_detect"})
    learned = Settings.of(hand_detect=replace(Settings.extraction.hand_detect, backend="sam3"))
    assert {node.name for node in build("dataset", Origin("x", bare=True), learned).stages()} == masked - {"scene_render"} | {
        "hand_detect", "record_hand_detect"}  # fmt: skip


def test_a_report_without_ground_truth_is_refused(folder: Path, tmp_path: Path) -> None:
    """One sentence with advice."""
    done = call("run", "extraction-report", "--source", folder, "--store", tmp_path)
    assert done.code != 0 and "the source has no masks and ground truth" in done.words
