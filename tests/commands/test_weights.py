"""Weights of stages: resolved once, digested into the keys of the stages that read them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from afford.extraction.prompted.files import DECODER, ENCODER, FOLDER
from afford.extraction.tracks import Sam2
from afford.models.weights import file_stamps, find_model, weight_files, weights_root, with_local_weights
from commands import backends
from commands.errors import UsageError
from commands.settings import settings
from commands.weights import reads_weights, resolve_weights
from maps.common import weights
from maps.settings import Origin, Settings
from pipeline import build
from runner import Graph
from schemas.files import FileRef, FileTree
from schemas.scene import RenderedClip
from stages.twohands.model_train import training_job
from tests.helpers.tiny_root import digest

ROOT = Path(__file__).resolve().parents[2]
FROM_SETUP = ("hand_landmarks", "segment", "model_train")
"""networks that `make setup` fetches; they are not chosen by a setting"""


def from_setup_only(found: Settings) -> bool:
    """Test that nothing but the networks of set-up was added to the defaults."""
    return replace(found, weights=()) == Settings() and all(stage in FROM_SETUP for stage, _ in found.weights)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    folder = tmp_path / "model"
    (folder / "sub").mkdir(parents=True)
    (folder / "config.json").write_text("{}")
    (folder / "sub" / "model.safetensors").write_bytes(b"weights")
    (folder / "README.md").write_text("words")
    return folder


def test_files_are_what_is_read_of_a_model(model: Path, tmp_path: Path) -> None:
    """Names and contents count; documentation files and the location do not."""
    found = weight_files(str(model), digest)
    assert [file.name for file in found.files] == ["config.json", "sub/model.safetensors"] and weights_root(found) == model
    (model / "README.md").write_text("other words")
    moved = Path(shutil.copytree(model, tmp_path / "elsewhere"))
    other = weight_files(str(moved), digest)
    assert [(one.name, one.digest) for one in other.files] == [(one.name, one.digest) for one in found.files]
    assert other.name == found.name and weights_root(other) == moved
    single = weight_files(str(model / "config.json"), digest)
    assert weights_root(single) == model / "config.json"


def test_params_hold_the_location_of_the_files(model: Path) -> None:
    params = Sam2("label")
    assert with_local_weights(params, None) is params
    assert with_local_weights(params, weight_files(str(model), digest)).model == str(model)


def test_files_under_other_names_are_given_theirs(tmp_path: Path) -> None:
    """The cache of a hub names files by digest; repeated calls give the same folder."""
    for name in ("0a1b", "2c3d"):
        (tmp_path / name).write_text(name)
    refs = (FileRef("config.json", "0", 4, tmp_path / "0a1b"), FileRef("sub/x.safetensors", "1", 4, tmp_path / "2c3d"))
    folder = weights_root(FileTree("weights", refs))
    assert (folder / "config.json").read_text() == "0a1b" and (folder / "sub" / "x.safetensors").read_text() == "2c3d"
    assert weights_root(FileTree("weights", refs)) == folder
    assert weights_root(FileTree("weights", refs[:1])).read_text() == "0a1b"


def test_a_stamp_tells_changed_files(model: Path) -> None:
    before = file_stamps(model)
    (model / "sub" / "model.safetensors").write_bytes(b"weightz")
    assert file_stamps(model) != before and file_stamps(model) == file_stamps(model)


def test_settings_carry_files_of_stages_that_read_them(model: Path) -> None:
    """Backends without weights and server models have none; in the graph the files are an input. Set-up adds its networks."""
    chosen = settings(["mask_densify.backend=sam2", f"mask_densify.sam2.model={model}", f"object_completion.sam2.model={model}",
                       "part_describe.backend=endpoint", "part_describe.endpoint.model=gpt"], None)  # fmt: skip
    found = resolve_weights(chosen, digest)
    assert [stage for stage, _ in found.weights if stage not in FROM_SETUP] == ["mask_densify"]
    assert (found.extraction.mask_densify.sam2.model, found.surface.part_describe.endpoint.model) == ("model", "gpt")
    assert weights(Graph(), found, "mask_densify").keys() == {"weights"} and not weights(Graph(), found, "object_completion")
    assert from_setup_only(resolve_weights(Settings(), digest)) and not weights(Graph(), Settings(), "mask_densify")


def test_a_network_of_held_objects_is_an_input(model: Path) -> None:
    """A named folder becomes files; `none` and `trained` need no files."""
    named = resolve_weights(settings([f"hand_detect.held={model}"], None), digest)
    assert dict(named.weights)["held"].find("config.json") and named.extraction.hand_detect.held == model.name
    for word in ("none", "trained"):
        assert "held" not in dict(resolve_weights(settings([f"hand_detect.held={word}"], None), digest).weights)
    with pytest.raises(UsageError, match=r"hand_detect\.held: .*got nothing there"):
        resolve_weights(settings(["hand_detect.held=/no/such/folder"], None), digest)


def test_the_outlining_networks_of_set_up_are_an_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Both files by content where set-up put them and unless `none` is asked for; hand_detect reads them from the graph."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert "segment" not in dict(resolve_weights(Settings(), digest).weights)
    for name in (ENCODER, DECODER):
        path = tmp_path / FOLDER / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    found = resolve_weights(Settings(), digest)
    assert {file.name for file in dict(found.weights)["segment"].files} == {ENCODER, DECODER}
    assert "segment" not in dict(resolve_weights(settings(["hand_detect.segment=none"], None), digest).weights)
    none = FileTree("a", ())
    place = Origin("v", videos=(RenderedClip(none, none, none),), bare=True)
    for chosen, there in ((found, True), (Settings(), False)):
        given = replace(chosen, weights=(*chosen.weights, ("hand_landmarks", none)))
        (detection,) = (node for node in build("recordings", place, given).stages() if node.name == "hand_detect")
        assert ("segment" in dict(detection.inputs)) == there


def test_the_initial_weights_of_a_training_are_an_input(model: Path) -> None:
    """A changed checkpoint is another training; its location does not count. A backend without pretrained parts refuses it."""
    plain = build("train", Origin("x"), Settings())
    chosen = settings(["model_train.variant=clip", f"model_train.backbones={model}", f"sor3d_train.backbones={model}"], None)
    found = resolve_weights(chosen, digest)
    assert found.twohands.model_train.backbones == found.rgbd.sor3d_train.backbones == "model"
    for target in ("train", "ablation", "sor3d", "sor3d-ablation"):
        every = build(target, Origin("x"), found).stages()
        trainings = [node for node in every if node.name.endswith(("model_train", "sor3d_train"))]
        assert trainings and all("weights" in dict(node.inputs) for node in trainings if not node.name.startswith("record")), target
    assert not any("weights" in dict(node.inputs) for node in plain.stages())
    with pytest.raises(UsageError, match=r"sor3d_train\.backbones: .*got nothing there"):
        resolve_weights(settings(["sor3d_train.backbones=/no/such/place"], None), digest)


def test_rows_of_the_ablation_have_the_named_parts_alone(model: Path) -> None:
    """Parts that are named are an input, the encoder of set-up is not; rows have the size of `small`, or the one asked for."""
    sides = "model_train.height_px=64", "model_train.width_px=96"
    for sets, wanted, size in (([], "", (128, 160)), ([f"model_train.backbones={model}"], "model", (128, 160)),
                               ([f"model_train.backbones={model}", *sides], "model", (64, 96)),
                               ([f"model_train.backbones={model}", "model_train.variant=clip"], "model", (1024, 1024)),
                               (["model_train.variant=small", *sides], "", (64, 96))):
        chosen = resolve_weights(settings(sets, None), digest)
        given = replace(chosen, weights=(("model_train", FileTree("encoder", ())), *chosen.weights) if not sets else chosen.weights)
        graph = build("ablation", Origin("x"), given)
        trainings = [node for node in graph.stages() if node.name.endswith("model_train")]
        assert trainings and all(("weights" in dict(node.inputs)) == bool(wanted) for node in trainings)
        assert {node.params.backbones for node in trainings} == {wanted}
        planned = next(node.value for node in graph.nodes if node.name == "recipes")
        full = next(recipe for recipe in planned if recipe.row == "full")
        assert {training_job(node.params, full).config.size_px for node in trainings} == {size}


@pytest.mark.parametrize(("name", "message"), [
    ("/no/such/place", "got nothing there; check the path"), ("EMPTY", "has no files of a model")])
def test_a_missing_model_is_a_usage_error(name: str, message: str, tmp_path: Path) -> None:
    """The parameter is named."""
    name = str(tmp_path) if name == "EMPTY" else name
    with pytest.raises(UsageError, match=f"mask_densify.sam2.model: .*{message}"):
        resolve_weights(settings(["mask_densify.backend=sam2", f"mask_densify.sam2.model={name}"], None), digest)


def test_a_backend_that_reads_weights_is_refused_without_any(model: Path) -> None:
    """The error comes before a clip is read, and describes the weights. A default backend without a model is accepted."""
    with pytest.raises(UsageError, match=r"mask_densify.backend=sam2 .*mask_densify.sam2.model=MODEL, a Sam2VideoModel"):
        resolve_weights(settings(["mask_densify.backend=sam2"], None), digest)
    assert reads_weights(Settings.grasping.grasp_judge) and from_setup_only(resolve_weights(Settings(), digest))


def test_a_hub_id_without_a_network_is_one_sentence(tmp_path: Path) -> None:
    """Downloaded models are found; for others the error says how to get them."""
    code = ("from afford.models.weights import find_model\ntry:\n    find_model('some-owner/some-model')\n"
            "except ValueError as error:\n    print(error)")  # fmt: skip
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "expected a local folder, or a hub id that is in the cache" in done.stdout and done.stdout.count("\n") == 1
    cached = tmp_path / "hub" / "models--some-owner--some-model"
    (cached / "refs").mkdir(parents=True)
    (cached / "refs" / "main").write_text("0123456789abcdef0123456789abcdef01234567")
    (cached / "snapshots" / "0123456789abcdef0123456789abcdef01234567").mkdir(parents=True)
    (cached / "snapshots" / "0123456789abcdef0123456789abcdef01234567" / "config.json").write_text("{}")
    printing = code.replace("    find_model(", "    print(find_model(").replace("model')", "model'))")
    done = subprocess.run([sys.executable, "-c", printing], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.stdout.strip().endswith("snapshots/0123456789abcdef0123456789abcdef01234567"), done.stdout + done.stderr


@pytest.mark.parametrize(("name", "repository", "revision"), [
    ("owner/model", "owner/model", None), ("model@v1.0", "model", "v1.0"), ("owner/model@refs/pr/1", "owner/model", "refs/pr/1"),
    ("owner/model@0123456789abcdef0123456789abcdef01234567", "owner/model", "0123456789abcdef0123456789abcdef01234567")])
def test_a_revision_that_a_hub_id_names_is_the_one_that_is_downloaded(
    name: str, repository: str, revision: str | None, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The newest without one. The parameters keep the full name, so that a run states its revision."""
    called = []

    def download(repository: str, *, revision: str | None, allow_patterns: list[str]) -> str:
        called.append((repository, revision))
        return str(model)

    monkeypatch.setattr("huggingface_hub.snapshot_download", download)
    chosen = resolve_weights(settings(["mask_densify.backend=sam2", f"mask_densify.sam2.model={name}"], None), digest)
    assert called == [(repository, revision)] and chosen.extraction.mask_densify.sam2.model == name


@pytest.mark.parametrize("name", ["owner/model@", "owner/model@-x", "owner/model@a b", "owner/model@a@b", "@main"])
def test_an_invalid_revision_is_refused(name: str) -> None:
    """The error comes before any download."""
    with pytest.raises(ValueError, match=r"OWNER/NAME or OWNER/NAME@REVISION\), got nothing there"):
        find_model(name)


def test_a_revision_is_looked_for_in_the_cache_of_downloads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`pipeline.py backends` does not accept another revision of the same model."""
    commit = "0123456789abcdef0123456789abcdef01234567"
    snapshot = tmp_path / "models--owner--model" / "snapshots" / commit
    snapshot.mkdir(parents=True)
    (snapshot / "config.json").write_text("{}")
    monkeypatch.setattr("huggingface_hub.file_download.constants.HF_HUB_CACHE", str(tmp_path))
    assert backends._in_cache(f"owner/model@{commit}") and not backends._in_cache("owner/model@v2")


def test_local_places_are_taken_as_they_are(model: Path) -> None:
    assert find_model(str(model)) == model
