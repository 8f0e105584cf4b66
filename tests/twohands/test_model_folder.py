"""Saved models: the same answers, the same bytes, and nothing loaded that does not fit."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from afford.twohands.model.interface import Batch, ModelConfig, build
from afford.twohands.model.model_folder import (
    PRESENCE_FILE,
    VOCABULARY_FILE,
    Vocabulary,
    find_model,
    load_model,
    save_model,
    write_vocabulary,
)
from afford.twohands.model.presence import Presence, write_presence

TINY = ModelConfig(size_px=(32, 48), widths=(16, 16, 32), depth=1, decoder_depth=1, text_buckets=64, threshold=0.35)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_model(build(TINY, 1), tmp_path / "model")
    return tmp_path / "model"


def test_a_saved_model_answers_the_same(folder: Path) -> None:
    """Exactly, and its config comes back, the chosen threshold too."""
    b = Batch(torch.rand(2, 3, 32, 48), ("cut bread", "open jar"))
    one, two = build(TINY, 1).eval()(b), load_model(folder)(b)
    assert torch.equal(one.logits, two.logits) and torch.equal(one.score, two.score) and torch.equal(one.taxonomy, two.taxonomy)
    assert load_model(folder).config == TINY


def test_a_published_training_is_a_model_folder(folder: Path, tmp_path: Path) -> None:
    """The folder above `model/` loads as the model itself; a folder with neither is refused by its own name."""
    (tmp_path / "published").mkdir()
    folder.rename(tmp_path / "published" / "model")
    assert load_model(tmp_path / "published").config == TINY
    with pytest.raises(ValueError, match="empty"):
        load_model(tmp_path / "empty")


def test_two_files_and_always_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    """config.json and model.safetensors, byte for byte."""
    save_model(build(TINY, 1), tmp_path / "again")
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["config.json", "model.safetensors"]
    assert all((folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes() for name in names)


def test_the_digest_covers_every_file_that_answers_depend_on(folder: Path) -> None:
    """Weights, vocabulary, and presence with its numbers; not what else lies there."""
    digests = [find_model(folder).digest]
    write_vocabulary(Vocabulary(("cut",), ("bread",), ("bread", "cut")), folder)
    digests.append(find_model(folder).digest)
    for least in (0.2, 0.3):
        write_presence(Presence(0.0, 1.0, 0.0, 0.0, least), folder)
        digests.append(find_model(folder).digest)
    assert len(set(digests)) == 4 and {VOCABULARY_FILE, PRESENCE_FILE} < {path.name for path in folder.iterdir()}
    (folder / "card.md").write_text("words")
    assert find_model(folder).digest == digests[-1]


def test_tensors_that_do_not_fit_are_named(folder: Path) -> None:
    """A missing, an extra and a misshaped one in one sentence."""
    weights = load_file(folder / "model.safetensors")
    weights["decoder.fine.bias"] = torch.zeros(5)
    weights["decoder.surplus"] = torch.zeros(1)
    del weights["decoder.queries"]
    save_file(weights, folder / "model.safetensors")
    with pytest.raises(ValueError, match=r"3 of \d+ tensors(?s:.)*misshaped decoder\.fine\.bias: expected \(16,\), got \(5,\)"
                       r"(?s:.)*missing decoder\.queries(?s:.)*extra decoder\.surplus"):  # fmt: skip
        load_model(folder)


def test_a_config_that_is_not_ours_is_refused(folder: Path, tmp_path: Path) -> None:
    """No file, other JSON, an unknown field, no weights."""
    with pytest.raises(ValueError, match="expected the config of a trained"):
        load_model(tmp_path / "nowhere")
    (folder / "config.json").write_text("[1]")
    with pytest.raises(ValueError, match="afford-twohands-1"):
        load_model(folder)
    fields = {"format": "afford-twohands-1", **dataclasses.asdict(TINY), "colour": 3}
    (folder / "config.json").write_text(json.dumps(fields))
    with pytest.raises(ValueError, match="no field colour"):
        load_model(folder)
    del fields["colour"]
    (folder / "config.json").write_text(json.dumps(fields))
    (folder / "model.safetensors").write_bytes(b"not weights")
    with pytest.raises(ValueError, match="as safetensors"):
        load_model(folder)
