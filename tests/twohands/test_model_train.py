"""Stage model_train: equal bytes when run again or resumed, its outputs, and its parameters."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from safetensors.torch import load_file

from afford.models.weights import weight_files, with_local_weights
from afford.recording.check_file import check_file
from afford.recording.mcap_files import EPOCH_NS, open_recording
from afford.training import curves, train
from afford.training.job import read_job
from afford.twohands.model.calibration import calibrated
from afford.twohands.model.interface import build
from afford.twohands.model.model_folder import save_model
from afford.twohands.model.predictor import Predictor
from maps.twohands import recipes
from schemas.files import FileTree
from schemas.training import Recipe, Trained
from stages.extraction import dataset_pack
from stages.recording import training_record
from stages.twohands import ablation_report, model_train, predict_cases, score_cases
from tests.helpers.made_cases import as_tree, write_benchmark
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
    """Context that interrupts the training after some steps."""

    def progress(self, done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt


def refs(tree: FileTree) -> list[tuple[str, str]]:
    return [(file.name, file.digest) for file in tree.files]


def test_a_resumed_training_gives_equal_files(dataset: FileTree, trained: Trained, tmp_path: Path) -> None:
    """A training in another folder is interrupted one step after a checkpoint; every file is equal to the byte."""
    with pytest.raises(KeyboardInterrupt):
        model_train.run(dataset, PARAMS, Killed(tmp_path))
    assert refs(model_train.run(dataset, PARAMS, Scratch(tmp_path)).files) == refs(trained.files)


def _words(trained: Trained) -> str:
    return next(file.path.read_text() for file in trained.files.under("model") if file.name.endswith("words.json"))


def test_a_training_begins_from_a_trained_model(dataset: FileTree, trained: Trained, tmp_path: Path) -> None:
    """Weights stay those of the model that it began from when the rate is 0; another size and other variants are refused."""
    model = FileTree("begun", trained.files.files)
    still = replace(PARAMS, steps=2, validate_every=2, lr=0.0, weight_decay=0.0, seed=8)
    found = model_train.run(dataset, still, Scratch(tmp_path / "a"), start=model)
    before, after = (load_file(tree.under("model")[1].path) for tree in (trained.files, found.files))
    drawn = {name for name in before if not torch.equal(before[name], after[name])}
    assert not {name for name in drawn if "running" not in name and "num_batches" not in name}
    assert json.loads(_words(found)) == json.loads(_words(trained))
    with pytest.raises(ValueError, match="set the sizes of the training to those"):
        model_train.run(dataset, replace(still, hypotheses=3), Scratch(tmp_path / "b"), start=model)
    with pytest.raises(ValueError, match=r"model_train\.start: expected none for variant clip"):
        model_train.training_job(replace(model_train.CLIP, start="somewhere"))


def test_the_saved_model_predicts(trained: Trained, tmp_path: Path) -> None:
    """The folder is enough for the predictor, and contains the threshold of the best validation."""
    for file in trained.files.under("model"):
        (tmp_path / file.name.removeprefix("model/")).write_bytes(file.path.read_bytes())
    predictor = Predictor(tmp_path)
    found = predictor.predict(np.zeros((50, 80, 3), np.uint8), "open jar")
    curves = {curve.name: curve.value[curve.step == trained.log.best_step] for curve in trained.log.curves}
    at = curves["val.slope"][0], curves["val.offset"][0]
    assert found.probability.shape == (2, 1, 50, 80)
    assert found.calibration == at
    assert predictor.model.config.threshold == round(calibrated(curves["val.threshold"][0], at), 4)


def test_the_vocabulary_is_that_of_the_training_split(dataset: FileTree, trained: Trained) -> None:
    """words.json has the verbs, objects and words of `train`."""
    path = next(file.path for file in dataset.files if file.name.startswith("data/train-"))
    rows = pq.read_table(path, columns=["narration", "verb", "noun"]).to_pylist()
    words = json.loads(trained.files.find("model/words.json").path.read_text())
    assert words["verbs"] == sorted({row["verb"] for row in rows}) and words["things"] == sorted({row["noun"] for row in rows})
    assert words["words"] == sorted({word for row in rows for word in row["narration"].lower().replace(",", "").split()})


def test_curves_agree_in_log_table_and_events(trained: Trained) -> None:
    """Equal values at equal steps in the log, the table and the event file."""
    table = pq.read_table(trained.files.find("history.parquet").path).to_pylist()
    logged = [(step, curve.name, value) for curve in trained.log.curves
              for step, value in zip(curve.step, curve.value, strict=True)]
    assert [(row["step"], row["name"], row["value"]) for row in table] == logged
    assert {"train.total", "train.lr", "val.iou", "val.threshold"} <= {name for _, name, _ in logged}
    found = read_events(trained.files.find(f"tensorboard/{curves.EVENTS_FILE}").path.read_bytes())
    wanted = sorted((step, name.replace(".", "/", 1), pytest.approx(value, rel=1e-6)) for step, name, value in logged)
    assert sorted(found) == wanted


def test_the_card_names_licence_data_and_figures(dataset: FileTree, trained: Trained) -> None:
    """Licence of the data set, its digest, seeds and figures."""
    text = trained.files.find("card.md").path.read_text()
    assert f"license: {dataset_licence(dataset)}" in text and "| train | val |" in text
    assert '"seed": 5' in text and "| samples | 24 | 8 |" in text and "| iou |" in text


def test_a_recipe_overrides_parameters(dataset: FileTree, tmp_path: Path) -> None:
    """A row of an ablation trains another model under its own name; other parameters are kept."""
    recipe = Recipe("k1-7", "k1", "small", 1, False, 1, "object", 7, "stills", False, True, 0)
    found = model_train.run(dataset, replace(PARAMS, steps=2, validate_every=0), Scratch(tmp_path), recipe)
    config = json.loads(found.files.find("model/config.json").path.read_text())
    assert (config["hypotheses"], config["text"], config["decoders"], found.log.name) == (1, False, 1, "k1-7")
    assert found.log.best_step == 2 and "None: the last weights were kept" in found.files.find("card.md").path.read_text()


def test_clip_without_backbones_is_trained_whole(dataset: FileTree, tmp_path: Path) -> None:
    """2HAff-CLIP from random weights is square, trains at full size in sequence, and has no frozen parameters."""
    params = replace(PARAMS, steps=1, warmup=1, validate_every=0, val_samples=2, height_px=32, width_px=64)
    job = model_train.training_job(replace(params, variant="clip"))
    assert (job.config.size_px, job.config.frozen, job.plan.parallel, job.coarse_share) == ((32, 32), False, 1, 0)
    with pytest.raises(ValueError, match="expected no backbones for variant small"):
        model_train.training_job(model_train.Params(backbones="folder"))
    assert not job.config.frozen and model_train.training_job(replace(params, variant="clip", backbones="folder")).config.frozen
    recipe = Recipe("clip-5", "clip", "clip", 3, True, 2, "affordance", 5, "stills", False, True, 0)
    found = model_train.run(dataset, params, Scratch(tmp_path), recipe)
    assert json.loads(found.files.find("model/config.json").path.read_text())["variant"] == "clip"
    assert model_train.training_job(PARAMS).plan.parallel == 2
    assert model_train.training_job(replace(PARAMS, devices=2)).plan.parallel == 1


@pytest.mark.parametrize("row", ["vlm", "lisa"])
def test_rows_with_a_language_model_are_trained_and_scored(dataset: FileTree, tmp_path: Path, row: str) -> None:
    """Tiny random parts end as a line of the report; lisa learns no taxonomy."""
    recipe = replace(recipes((row,), 1)[0], steps=2)
    params = replace(PARAMS, steps=9, batch=2, accumulate=1, val_samples=2)
    trained = model_train.run(dataset, params, Scratch(tmp_path / "trained"), recipe)
    assert trained.log.steps == 2 and {curve.name for curve in trained.log.curves} > {"train.text", "train.mask"}
    card = trained.files.find("card.md").path.read_text()
    assert ('"taxonomy_weight": 0.0' in card) == (row == "lisa")
    cases, once = as_tree(write_benchmark(tmp_path / "cases")), predict_cases.Params(name="", looks=1, mirror=False)
    found = predict_cases.run(cases, trained.files, once, Scratch(tmp_path / "found"))
    scored = score_cases.run(cases, found, score_cases.Params())
    tree = ablation_report.run((recipe,), (scored,), ablation_report.Params(), Scratch(tmp_path / "table"))
    text = tree.find("ablation.md").path.read_text()
    assert f"\n| {row} | 0." in text and f"- `{row}`: tiny random language model" in text


def test_a_model_depends_on_the_content_of_backbones_only(tmp_path: Path) -> None:
    """Equal weights in another folder give an equal model, other weights give another."""
    params = replace(PARAMS, variant="clip", steps=1, warmup=1, validate_every=0, val_samples=2, height_px=64, backbones="both")

    def saved(place: str, seed: int) -> dict[str, str]:
        weights = weight_files(str(save_backbones(tmp_path / place, seed=seed)), digest)
        model = build(model_train.training_job(with_local_weights(params, weights, "backbones")).config, params.seed)
        save_model(model, tmp_path / f"{place}-model")
        return {path.name: digest(path) for path in (tmp_path / f"{place}-model").rglob("*") if path.is_file()}

    first = saved("here", 0)
    assert saved("there", 0) == first != saved("other", 3)


@pytest.mark.slow
def test_a_training_depends_on_the_content_of_backbones_only(dataset: FileTree, tmp_path: Path) -> None:
    """The whole stage, from one content in two folders and from another content."""
    params = replace(PARAMS, variant="clip", steps=1, warmup=1, validate_every=0, val_samples=2, height_px=64, backbones="both")

    def trained(place: str, seed: int) -> dict[str, str]:
        weights = weight_files(str(save_backbones(tmp_path / place, seed=seed)), digest)
        found = model_train.run(dataset, params, Scratch(tmp_path / f"{place}-scratch"), weights=weights)
        return {file.name: digest(file.path) for file in found.files.files if file.name.startswith("model/")}

    first = trained("here", 0)
    assert trained("there", 0) == first != trained("other", 3)


def test_a_job_survives_json() -> None:
    job = model_train.training_job(PARAMS)
    assert read_job(job.to_json()) == job


def test_the_recording_has_curves_and_previews(trained: Trained, tmp_path: Path) -> None:
    """One topic for each curve, a millisecond for each step, and the previews; the file passes all checks."""
    tree = training_record.run(trained.log, trained.files, training_record.Params(), Scratch(tmp_path))
    assert check_file(tree.files[0].path) == []
    with open_recording(tree.files[0].path) as recording:
        times = [(message.topic, (message.time_ns - EPOCH_NS) // 1_000_000) for message in recording.messages]
    assert {("/model_train/val/iou", 3), ("/model_train/val/iou", 6), ("/model_train/preview", 6)} <= set(times)


def test_global_state_is_restored(trained: Trained) -> None:
    """Deterministic algorithms are off again after a training."""
    assert not torch.are_deterministic_algorithms_enabled()


@pytest.mark.slow
def test_two_devices_train_one_model(dataset: FileTree, tmp_path: Path) -> None:
    """The stage starts torch.distributed.run, and two runs give equal files."""
    params = replace(PARAMS, devices=2, batch=2, steps=4)
    files = []
    for name in "ab":
        (tmp_path / name).mkdir()
        files.append(refs(model_train.run(dataset, params, Scratch(tmp_path / name)).files))
    assert files[0] == files[1]
    job = replace(model_train.training_job(params), batch=0)
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
