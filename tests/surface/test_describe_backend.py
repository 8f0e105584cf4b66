"""Models that describe an object: a local one through the whole chain, and what becomes of it when the weights change."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.helpers.chat_server import GOOD, VARIABLE, plant, says, serving
from tests.helpers.learned_chain import content, flip_a_weight, run
from tests.helpers.tiny_models import save_backbones, save_chat
from tests.surface import test_describe_vlm
from tests.surface.test_describe_vlm import TASK

taught = test_describe_vlm.taught


def test_one_object_goes_through_the_whole_chain(taught: Path, tmp_path: Path) -> None:
    """A model that knows one answer is asked, CLIP finds its parts, a surface is written; a changed byte asks again."""
    chat = Path(shutil.copytree(taught, tmp_path / "chat"))
    clip = save_backbones(tmp_path / "models") / "clip"
    sets = ["part_describe.backend=vlm", f"part_describe.vlm.model={chat}", f"part_describe.tasks={TASK}",
            "mask_score.backend=clip", f"mask_score.clip.model={clip}"]  # fmt: skip
    runner, report = run(tmp_path / "store", sets)
    assert report.ok, report.failures
    told = runner.store.load(content(report, "negative_affordance_files"))
    assert told.files and not run(tmp_path / "store", sets)[1].ran
    (chat / "generation_config.json").write_text((chat / "generation_config.json").read_text() + "\n")
    assert set(run(tmp_path / "store", sets)[1].ran) == {"part_describe"}  # asked again, said the same


def test_a_random_model_fails_alone(tmp_path: Path) -> None:
    """Its babble is an answer to nothing; what does not need it is made; other weights babble otherwise."""
    found = []
    for seed in (0, 1):
        sets = ["part_describe.backend=vlm", f"part_describe.vlm.model={save_chat(tmp_path / str(seed), seed=seed)}",
                f"part_describe.tasks={TASK}", "part_describe.vlm.new_tokens=8"]  # fmt: skip
        _, report = run(tmp_path / "store", sets)
        assert report.failures[0].stage == "part_describe" and "mask_propose" in {*report.ran, *report.cached}
        found.append(report.failures[0].message)
    assert found[0] != found[1] and all("answer of backend 'vlm': expected one JSON object" in one for one in found)


def test_a_server_through_the_whole_chain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its answers are kept by what was asked: when the server is gone nothing is asked again."""
    plant(monkeypatch)
    clip = save_backbones(tmp_path / "models") / "clip"
    with serving(lambda _: says(GOOD)) as server:
        sets = ["part_describe.backend=endpoint", f"part_describe.endpoint.url={server.url}",
                "part_describe.endpoint.model=some-vlm",
                f"part_describe.endpoint.key_variable={VARIABLE}", f"part_describe.tasks={TASK}", "mask_score.backend=clip",
                f"mask_score.clip.model={clip}"]  # fmt: skip
        assert run(tmp_path / "store", sets)[1].ok and len(server.asked) == 1
    assert not run(tmp_path / "store", sets)[1].ran


def test_a_changed_weight_is_another_model(taught: Path, tmp_path: Path) -> None:
    """A model in memory is not taken for the files that replaced it."""
    chat = Path(shutil.copytree(taught, tmp_path / "chat"))
    before = test_describe_vlm.load_model(str(chat))
    assert test_describe_vlm.load_model(str(chat)) is before
    flip_a_weight(chat / "model.safetensors")
    assert test_describe_vlm.load_model(str(chat)) is not before
