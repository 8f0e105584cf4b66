"""The stage that trains two-hand models: the same bytes again, resumed or not; every form of data set; what it leaves."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from afford.models.weights import weight_files
from afford.recording.check_file import check_file
from afford.recording.mcap_files import EPOCH_NS, open_recording
from afford.training import curves, train
from afford.training.job import read_job
from afford.twohands.model.predictor import Predictor
from schemas.files import FileTree
from schemas.training import Recipe, Trained
from stages.extraction import dataset_pack
from stages.recording import training_record
from stages.twohands import model_train
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.tiny_models import save_backbones
from tests.helpers.tiny_root import digest

PARAMS = model_train.Params(steps=6, batch=4, warmup=2, validate_every=3, val_samples=6, height_px=64, width_px=96, seed=5)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    clips = (clip("P01_01", 24, split="train"), clip("P01_02", 8, split="val"))
    return dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(tmp_path_factory.mktemp("packed")))


@pytest.fixture(scope="module")
def trained(dataset: FileTree, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return model_train.run(dataset, PARAMS, Scratch(tmp_path_factory.mktemp("trained")))


class Killed(Scratch):
    """A context that ends the process, so to speak, after some steps."""

    def progress(self, done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt


def refs(tree: FileTree) -> list[tuple[str, str]]:
    return [(file.name, file.digest) for file in tree.files]


def test_killed_and_run_again_gives_the_same_files(dataset: FileTree, trained: Trained, tmp_path: Path) -> None:
    """Interrupted after a checkpoint and a few steps more, in another folder: every file is the same to the byte."""
    with pytest.raises(KeyboardInterrupt):
        model_train.run(dataset, PARAMS, Killed(tmp_path))
    assert refs(model_train.run(dataset, PARAMS, Scratch(tmp_path)).files) == refs(trained.files)


def test_it_leaves_a_model_that_predicts(trained: Trained, tmp_path: Path) -> None:
    """The folder alone is enough for the predictor, and holds the threshold that validation chose."""
    for file in trained.files.under("model"):
        (tmp_path / file.name.removeprefix("model/")).write_bytes(file.path.read_bytes())
    predictor = Predictor(tmp_path)
    said = predictor.predict(np.zeros((50, 80, 3), np.uint8), "open jar")
    thresholds = {curve.name: curve for curve in trained.log.curves}["val.threshold"]
    assert said.probability.shape == (2, 3, 50, 80)
    assert said.threshold == thresholds.value[thresholds.step == trained.log.best_step][0]


def test_it_leaves_the_words_that_taught_it(dataset: FileTree, trained: Trained) -> None:
    """Verbs, things and words of the part `train`, beside the weights."""
    path = next(file.path for file in dataset.files if file.name.startswith("data/train-"))
    rows = pq.read_table(path, columns=["narration", "verb", "noun"]).to_pylist()
    words = json.loads(trained.files.find("model/words.json").path.read_text())
    assert words["verbs"] == sorted({row["verb"] for row in rows}) and words["things"] == sorted({row["noun"] for row in rows})
    assert words["words"] == sorted({word for row in rows for word in row["narration"].lower().replace(",", "").split()})


def test_curves_are_the_same_everywhere(trained: Trained) -> None:
    """The log, the table and the event file say the same numbers at the same steps."""
    table = pq.read_table(trained.files.find("history.parquet").path).to_pylist()
    said = [(step, curve.name, value) for curve in trained.log.curves for step, value in zip(curve.step, curve.value, strict=True)]
    assert [(row["step"], row["name"], row["value"]) for row in table] == said
    assert {"train.total", "train.lr", "val.iou", "val.threshold"} <= {name for _, name, _ in said}
    found = read_events(trained.files.find(f"tensorboard/{curves.EVENTS_FILE}").path.read_bytes())
    assert sorted(found) == sorted((step, name.replace(".", "/", 1), pytest.approx(value, rel=1e-6)) for step, name, value in said)


def test_the_card_says_where_it_comes_from(dataset: FileTree, trained: Trained) -> None:
    """Licence of the data set, its digest, seeds and figures."""
    text = trained.files.find("card.md").path.read_text()
    assert f"license: {dataset_licence(dataset)}" in text and "| train | val |" in text
    assert '"seed": 5' in text and "| samples | 24 | 8 |" in text and "| iou |" in text


def test_a_recipe_replaces_what_it_names(dataset: FileTree, tmp_path: Path) -> None:
    """A row of an ablation trains another model under its own name; the rest is as the parameters say."""
    recipe = Recipe("k1-7", "k1", "small", 1, False, 1, "object", 7, "stills")
    found = model_train.run(dataset, replace(PARAMS, steps=2, validate_every=0), Scratch(tmp_path), recipe)
    config = json.loads(found.files.find("model/config.json").path.read_text())
    assert (config["hypotheses"], config["text"], config["decoders"], found.log.name) == (1, False, 1, "k1-7")
    assert found.log.best_step == 2 and "None: the last weights were kept" in found.files.find("card.md").path.read_text()


def test_what_has_no_pretrained_parts_is_trained_whole(dataset: FileTree, tmp_path: Path) -> None:
    """2HAff-CLIP from nothing is square, one micro-batch after the other at its full size, and none of it stays as it was."""
    params = replace(PARAMS, steps=1, warmup=1, validate_every=0, val_samples=2, height_px=32, width_px=64)
    job = model_train._job(replace(params, variant="clip"))
    assert (job.config.size_px, job.config.frozen, job.plan.parallel, job.coarse_share) == ((32, 32), False, 1, 0)
    with pytest.raises(ValueError, match="expected no backbones for variant small"):
        model_train._job(model_train.Params(backbones="folder"))
    assert not job.config.frozen and model_train._job(replace(params, variant="clip", backbones="folder")).config.frozen
    recipe = Recipe("clip-5", "clip", "clip", 3, True, 2, "affordance", 5, "stills")
    found = model_train.run(dataset, params, Scratch(tmp_path), recipe)
    assert json.loads(found.files.find("model/config.json").path.read_text())["variant"] == "clip"
    assert model_train._job(PARAMS).plan.parallel == 2 and model_train._job(replace(PARAMS, devices=2)).plan.parallel == 1


def test_where_pretrained_parts_lie_changes_nothing_and_what_they_hold_does(dataset: FileTree, tmp_path: Path) -> None:
    """They come as an input; the parameter only calls them something."""
    params = replace(PARAMS, variant="clip", steps=1, warmup=1, validate_every=0, val_samples=2, height_px=64, backbones="both")

    def made(place: str, seed: int) -> dict[str, str]:
        weights = weight_files(str(save_backbones(tmp_path / place, seed=seed)), digest)
        found = model_train.run(dataset, params, Scratch(tmp_path / f"{place}-scratch"), weights=weights)
        return {file.name: digest(file.path) for file in found.files.files if file.name.startswith("model/")}

    first = made("here", 0)
    assert made("there", 0) == first != made("other", 3)


def test_a_job_travels_as_text() -> None:
    """What a process reads is what was sent."""
    job = model_train._job(PARAMS)
    assert read_job(job.to_json()) == job


def test_the_recording_plots_and_shows(trained: Trained, tmp_path: Path) -> None:
    """A topic per curve, a millisecond per step, the previews beside them; the file passes every check."""
    tree = training_record.run(trained.log, trained.files, training_record.Params(), Scratch(tmp_path))
    assert check_file(tree.files[0].path) == []
    with open_recording(tree.files[0].path) as recording:
        times = [(message.topic, (message.time_ns - EPOCH_NS) // 1_000_000) for message in recording.messages]
    assert {("/model_train/val/iou", 3), ("/model_train/val/iou", 6), ("/model_train/preview", 6)} <= set(times)


def test_global_state_is_put_back(trained: Trained) -> None:
    """Threads and deterministic algorithms are as they were before."""
    assert not torch.are_deterministic_algorithms_enabled()


@pytest.mark.slow
def test_two_devices_train_one_model(dataset: FileTree, tmp_path: Path) -> None:
    """The stage starts the standard launcher; the result loads, and is the same when it is made again."""
    params = replace(PARAMS, devices=2, batch=2, steps=4)
    made = []
    for name in "ab":
        (tmp_path / name).mkdir()
        made.append(refs(model_train.run(dataset, params, Scratch(tmp_path / name)).files))
    assert made[0] == made[1]
    job = replace(model_train._job(params), batch=0)
    with pytest.raises(RuntimeError, match=r"2 processes of torch\.distributed\.run: exit code"):
        train.launch(job, tmp_path, 2, lambda done, total: None)


def dataset_licence(dataset: FileTree) -> str:
    lines = dataset.find("README.md").path.read_text().splitlines()
    return next(line.removeprefix("license: ") for line in lines if line.startswith("license: "))


def read_events(data: bytes) -> list[tuple[int, str, float]]:
    """Scalars of an event file, by hand, every checksum compared."""
    out, at = [], 0
    while at < len(data):
        (length,) = struct.unpack_from("<Q", data, at)
        body = data[at + 12 : at + 12 + length]
        assert struct.unpack_from("<I", data, at + 12 + length)[0] == masked_crc(body)
        assert struct.unpack_from("<I", data, at + 8)[0] == masked_crc(data[at : at + 8])
        at += 16 + length
        fields = proto(body)
        if 5 in fields:
            value = proto(proto(fields[5])[1])
            out.append((fields[2], value[1].decode(), struct.unpack("<f", value[2])[0]))
    return out


def masked_crc(data: bytes) -> int:
    """CRC-32C bit by bit, masked as TFRecord wants it."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x82F63B78 * (crc & 1)
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def proto(data: bytes) -> dict:
    """Field number -> value of one protobuf message."""
    out, at = {}, 0

    def varint() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte, at = data[at], at + 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7

    while at < len(data):
        key = varint()
        size = {0: 0, 1: 8, 5: 4}.get(key & 7)
        if size == 0:
            out[key >> 3] = varint()
            continue
        size = varint() if size is None else size
        out[key >> 3], at = data[at : at + size], at + size
    return out
