"""Shipped models: written as half floats with digests, read back, refused when changed; and those in `weights/`."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from afford.models import shipped
from afford.models.efficientnet_lite import EfficientNetLite0
from afford.models.encoder_place import FILE
from afford.models.shipped import CARD, FOLDER, MEASURED, RECORD, file_digest, find_shipped, read_record, shipped_files
from afford.twohands.model import lite
from afford.twohands.model.interface import Batch, ModelConfig, build
from afford.twohands.model.model_folder import load_model, save_model
from benchmarks.shipped import calibrate
from benchmarks.shipped.calibrate import write_card
from benchmarks.shipped.outlined import write_case
from benchmarks.shipped.recipes import RECIPES
from benchmarks.shipped.ship import MAX_TOTAL_BYTES, codes, paragraphs, reword, ship, stale
from commands.errors import UsageError
from commands.weights import resolve_weights
from maps.settings import Origin, Settings
from pipeline import build as build_graph
from schemas.files import FileTree
from tests.helpers.tiny_root import digest

MADE: dict[str, Any] = {"command": "make weights", "commit": "abc", "stages": {"train": "1"}, "seed": 0}
SHIPPED = sorted(path.name for path in FOLDER.glob("*") if path.is_dir())
TINY = ModelConfig(variant="lite", size_px=(64, 96), widths=(16, 24, 32), depth=1, decoder_depth=1, text_buckets=512)


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in place of `weights/`."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    return tmp_path / "weights"


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """Files of a trained model: floats, whole numbers, a config, and what is not of the model."""
    folder = tmp_path / "trained"
    (folder / "prior").mkdir(parents=True)
    tensors = {"a": torch.linspace(-2, 2, 7), "others.b": torch.ones(3), "steps": torch.tensor([5])}
    save_file(tensors, folder / "model.safetensors")
    save_file({"c": torch.ones(2)}, folder / "prior" / "policy.safetensors")
    (folder / "config.json").write_text('{"width": 3}')
    (folder / "history.parquet").write_bytes(b"rows")
    return folder


def test_a_shipped_model_has_half_floats_and_the_files_of_the_model(weights: Path, trained: Path) -> None:
    ship(trained, weights / "one", "# One", MADE, left_out="others.")
    found = find_shipped("one")
    assert found == weights / "one"
    names = {path.relative_to(found).as_posix() for path in found.rglob("*") if path.is_file()}
    assert names == {"model.safetensors", "prior/policy.safetensors", "config.json", CARD, RECORD}
    tensors = load_file(found / "model.safetensors")
    assert set(tensors) == {"a", "steps"} and tensors["a"].dtype == torch.float16 and tensors["steps"].dtype == torch.int64
    assert torch.allclose(tensors["a"].float(), torch.linspace(-2, 2, 7), atol=2**-10)
    tree = shipped_files("one", digest)
    assert tree is not None and {file.name for file in tree.files} == names - {CARD, RECORD}
    assert find_shipped("another") is None and shipped_files("another", digest) is None


@pytest.mark.parametrize("damage", ["changed", "deleted"])
def test_a_damaged_shipped_model_is_refused_in_one_sentence(weights: Path, trained: Path, damage: str) -> None:
    ship(trained, weights / "one", "# One", MADE)
    path = weights / "one" / "config.json"
    path.unlink() if damage == "deleted" else path.write_text("{}")
    with pytest.raises(ValueError, match=r"config\.json: expected the file that is shipped .*git checkout weights") as error:
        find_shipped("one")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "afford-weights-1"}', '{"format": "afford-weights-1", "files": [1]}',
                                  '{"format": "afford-weights-0", "files": {}}', "[" * 100_000])  # fmt: skip
def test_a_foreign_record_is_refused_in_one_sentence(weights: Path, text: str) -> None:
    (weights / "one").mkdir(parents=True)
    (weights / "one" / RECORD).write_text(text)
    with pytest.raises(ValueError, match=r"made\.json: expected") as error:
        find_shipped("one")
    assert "\n" not in str(error.value)


def test_figures_of_a_card_do_not_change_its_digest(tmp_path: Path) -> None:
    card = tmp_path / CARD
    card.write_text(f"# One\n\n{MEASURED[0]}\n{MEASURED[1]}\n")
    empty = file_digest(card)
    card.write_text(f"# One\n\n{MEASURED[0]}\n| IoU | 0.5 |\n{MEASURED[1]}\n")
    assert file_digest(card) == empty
    card.write_text(f"# Two\n\n{MEASURED[0]}\n{MEASURED[1]}\n")
    assert file_digest(card) != empty


def test_weights_beyond_half_floats_are_refused(weights: Path, trained: Path) -> None:
    save_file({"a": torch.tensor([1e6])}, trained / "model.safetensors")
    with pytest.raises(ValueError, match="below 65504"):
        ship(trained, weights / "one", "# One", MADE)


def test_a_two_hand_model_without_its_encoder_is_completed_from_set_up(weights: Path, tmp_path: Path,
                                                                       monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Predictions of the shipped model equal those of the trained one up to half precision."""
    torch.manual_seed(1)
    published = EfficientNetLite0()
    torch.save(published.state_dict(), tmp_path / FILE)
    model = build(replace(TINY, backbones=str(tmp_path)), 0).eval()
    save_model(model, tmp_path / "model")
    ship(tmp_path / "model", weights / "twohands", "# Two hands", MADE, left_out=lite.BACKBONE)
    assert not any(name.startswith(lite.BACKBONE) for name in load_file(weights / "twohands" / "model.safetensors"))
    monkeypatch.setattr(lite, "encoder_path", lambda: tmp_path / FILE)
    found = load_model(weights / "twohands")
    asked = Batch(torch.rand(1, 3, *TINY.size_px, generator=torch.Generator().manual_seed(3)), ("open jar",))
    with torch.no_grad():
        assert torch.allclose(found(asked).logits, model(asked).logits, atol=0.05)
    monkeypatch.setattr(lite, "encoder_path", lambda: tmp_path / "none" / FILE)
    with pytest.raises(ValueError, match=r"run `python install/image_encoder\.py`"):
        load_model(weights / "twohands")


def test_meshes_of_a_user_are_scored_without_a_training(weights: Path, trained: Path) -> None:
    """The shipped scorer replaces the training for meshes, unless parameters of the training are set; measures still train."""
    ship(trained, weights / shipped.PARTS, "# Parts", MADE)
    meshes = Origin("mine", meshes=(FileTree("mug", ()),))
    usual = resolve_weights(Settings(), digest, "negative-affordance")
    other = Settings()
    longer = replace(other.surface.scorer_train, steps=9)
    asked = resolve_weights(other.with_stages(scorer_train=longer), digest, "negative-affordance")

    def trains(origin: Origin, p: Settings) -> bool:
        return any(node.name == "scorer_train" for node in build_graph("negative-affordance", origin, p).stages())

    assert not trains(meshes, usual) and trains(meshes, asked)
    assert trains(Origin("negative-affordance"), usual) and trains(meshes, Settings())


def test_shipped_models_are_found_without_torch() -> None:
    """Every run resolves its models first, and torch takes longer to load than a run with nothing to do."""
    code = ("import sys; from commands.weights import resolve_weights; from maps.settings import Settings; "
            "resolve_weights(Settings(), lambda path: '', 'negative-affordance'); sys.exit('torch' in sys.modules)")  # fmt: skip
    assert subprocess.run((sys.executable, "-c", code), cwd=FOLDER.parent).returncode == 0


def test_a_new_model_leaves_no_file_of_the_one_before(weights: Path, trained: Path) -> None:
    for name in ("presence.json", "card.txt"):
        (weights / shipped.PARTS).mkdir(parents=True, exist_ok=True)
        (weights / shipped.PARTS / name).write_text("{}")
    ship(trained, weights / shipped.PARTS, "# Parts", MADE)
    left = {path.name for path in (weights / shipped.PARTS).iterdir() if path.is_file()}
    assert "presence.json" not in left and "card.txt" in left and find_shipped(shipped.PARTS)


@pytest.mark.parametrize("same", [True, False])
def test_figures_stay_where_a_training_made_the_same_files(weights: Path, trained: Path, same: bool) -> None:
    ship(trained, weights / "one", "# One", MADE)
    card = weights / "one" / CARD
    card.write_text(card.read_text().replace(MEASURED[0], f"{MEASURED[0]}\n| IoU | 0.5 |"))
    if not same:
        (trained / "config.json").write_text('{"width": 4}')
    ship(trained, weights / "one", "# Again", MADE)
    assert "# Again" in card.read_text() and ("| IoU | 0.5 |" in card.read_text()) == same
    assert find_shipped("one") and card.read_text().endswith(f"|\n{MEASURED[1]}\n" if same else f"{MEASURED[0]}\n{MEASURED[1]}\n")


def test_a_damaged_model_stops_the_targets_that_use_it_alone(weights: Path, trained: Path) -> None:
    ship(trained, weights / shipped.PARTS, "# Parts", MADE)
    (weights / shipped.PARTS / "config.json").write_text("{}")
    assert "shipped_scorer_train" not in dict(resolve_weights(Settings(), digest, "dataset").weights)
    with pytest.raises(UsageError, match="git checkout weights"):
        resolve_weights(Settings(), digest, "negative-affordance")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_files_have_their_digests_a_card_and_a_record(name: str) -> None:
    found = find_shipped(name)
    assert found is not None
    card, record = (found / CARD).read_text(), read_record(found)
    assert all(part in card for part in ("**For**", "**Limits.**", "**Data.**", "**Licence**", "**Made**", "## Figures", *MEASURED))
    assert all(words in card for words in paragraphs(RECIPES[name]).values()), "run benchmarks/shipped/ship.py --words"
    assert "|" in card.partition(MEASURED[0])[2], "run benchmarks/shipped/score.py"
    assert record["seed"] == 0 and record["stages"] and record["keys"] and not any("/" in text for text in record["sets"])
    files = {path.relative_to(found).as_posix() for path in found.rglob("*") if path.suffix in (".json", ".safetensors", ".md")}
    assert set(record["files"]) == files - {RECORD}
    assert not any("backbone" in key for path in found.rglob("*.safetensors") for key in load_file(path)), "third-party weights"


def test_words_of_a_recipe_enter_its_card_and_the_digest(tmp_path: Path, trained: Path) -> None:
    recipe = RECIPES["parts"]
    ship(trained, tmp_path, "\n\n".join(("# Parts", "**For** others", *list(paragraphs(recipe).values())[1:], "Kept.")), MADE)
    reword(tmp_path, recipe)
    card = (tmp_path / CARD).read_text()
    assert all(card.count(words) == 1 for words in paragraphs(recipe).values()) and "Kept." in card and "others" not in card
    assert read_record(tmp_path)["files"][CARD] == file_digest(tmp_path / CARD)
    (tmp_path / CARD).write_text("# Parts\n")
    with pytest.raises(SystemExit, match="expected one paragraph 'For'"):
        reword(tmp_path, recipe)


def test_shipped_files_are_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) <= MAX_TOTAL_BYTES


def test_models_made_by_other_code_are_named(weights: Path, trained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.shipped.ship.FOLDER", weights)
    now = codes(RECIPES["parts"].graph(lambda path: ""))
    ship(trained, weights / "parts", "# Parts", {**MADE, "stages": now})
    assert not list(stale(["parts", "sor3d"]))
    ship(trained, weights / "parts", "# Parts", {**MADE, "stages": {**now, "scorer_train": "other", "gone": "1"}})
    assert list(stale(["parts"])) == [("parts", ["gone", "scorer_train"])]


def test_a_calibration_is_in_the_card_once_and_in_no_other_card(tmp_path: Path) -> None:
    card = tmp_path / CARD
    card.write_text("# Model\n\nfitted here, and the threshold 0.2036 was chosen.\n\n## Figures\n")
    for line in ("Then it was fitted again.", "Then once more."):
        write_card(card, line)
    assert card.read_text() == "# Model\n\nfitted here, and the threshold 0.2036 was chosen. Then once more.\n\n## Figures\n"
    card.write_text("# Parts\n")
    with pytest.raises(SystemExit, match="expected one sentence"):
        write_card(card, "Then it was fitted again.")
    assert card.read_text() == "# Parts\n"


def test_a_calibration_uses_crops_of_other_settings_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mask = np.zeros((20, 30), bool)
    mask[5:9, 5:9] = True
    for kind, scene in (("cropped", "kitchen"), ("cropped", "workshop"), ("masks", "workshop")):
        folder = tmp_path / kind / scene / "0000001"
        write_case(folder, np.zeros((20, 30, 3), np.uint8), "take saw", [{"right": mask}])
        told = json.loads((folder / "annotation.json").read_text())
        (folder / "annotation.json").write_text(json.dumps({**told, "scene": scene}))
    assert [case.video for case in calibrate.unfamiliar(tmp_path)] == ["workshop"]
    shutil.rmtree(tmp_path / "cropped" / "workshop")
    monkeypatch.setattr(sys, "argv", ["calibrate.py", "--cases", str(tmp_path)])
    before = {path.name: file_digest(path) for path in (FOLDER / "twohands").glob("*.*")}
    with pytest.raises(SystemExit, match="expected crops of workshops or desks"):
        calibrate.main()
    assert {path.name: file_digest(path) for path in (FOLDER / "twohands").glob("*.*")} == before
