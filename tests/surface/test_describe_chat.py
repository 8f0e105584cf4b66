"""Local vision-language model as a describer: real loading and prompting of a tiny LLaVA, random or trained on one answer."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from afford.models.chat_model import ChatModel, generate, inputs, load_model
from afford.render.views.draw import contact_sheet, sheet_labels
from afford.surface.describe.prompt import part_prompt
from stages.surface import part_describe
from tests.helpers.blocks import changed
from tests.helpers.chat_server import GOOD, VARIABLE, plant, says, serving
from tests.helpers.learned_chain import content, flip_a_weight, run
from tests.helpers.made_objects import looked
from tests.helpers.tiny_models import save_backbones, save_chat

TASK = "drive a screw"
STEPS = 300


@pytest.fixture(scope="module")
def random(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_chat(tmp_path_factory.mktemp("random"))


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train a model to give one answer to one prompt about one sheet."""
    asked, sheet = given()
    folder = save_chat(tmp_path_factory.mktemp("taught"), (asked, GOOD))
    chat = load_model(str(folder))
    teach(chat, asked, sheet, GOOD + "</s>")
    chat.model.save_pretrained(folder)
    return folder


def given() -> tuple[str, np.ndarray]:
    x = looked()
    return part_prompt(x.mesh.category, TASK, sheet_labels(x.views, 6)), contact_sheet(x.views, 6)


def teach(chat: ChatModel, asked: str, sheet: np.ndarray, answer: str) -> None:
    """Train with Adam on the tokens of the answer until each is by far the likeliest."""
    batch = inputs(chat, asked, sheet)
    words = torch.tensor([chat.processor.tokenizer.encode(answer, add_special_tokens=False)])
    ids = torch.cat([batch["input_ids"], words], 1)
    wanted = torch.cat([torch.full_like(batch["input_ids"], -100), words], 1)
    whole = {"input_ids": ids, "attention_mask": torch.ones_like(ids), "pixel_values": batch["pixel_values"], "labels": wanted}
    optimiser = torch.optim.Adam(chat.model.parameters(), 3e-3)
    for _ in range(STEPS):
        loss = chat.model(**whole).loss
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if loss < 0.02:
            return
    raise AssertionError(f"it did not learn its answer: loss {loss:.3f} after {STEPS} steps")


def described(model: Path | str, **more: int) -> part_describe.PartDescriptions:
    params = changed(part_describe.Params("vlm", (TASK,)), model=str(model), **more)
    return part_describe.run(looked().mesh, looked().views, params)


def test_answer_of_a_model_becomes_notes(taught: Path) -> None:
    """Check folder, processor, template, greedy decoding and parser, twice with the same result."""
    [found] = described(taught).descriptions
    assert (found.category, found.backend, found.task) == ("screwdriver", "vlm", TASK)
    wanted = [(part["part"], part["role"], part["reason"], part["confidence"]) for part in json.loads(GOOD)["parts"]]
    assert [(note.part, note.role, note.reason, note.confidence) for note in found.notes] == wanted
    assert described(taught).descriptions == (found,)


def test_truncated_answer_is_refused(taught: Path) -> None:
    """Check that the error shows the beginning and names the parameter."""
    with pytest.raises(ValueError, match=r"expected one JSON object .*screwdriver.*raise new_tokens if the answer was cut off"):
        described(taught, new_tokens=12)


def test_random_model_gives_no_description(random: Path) -> None:
    """Check that the error shows the random text."""
    babble = generate(load_model(str(random)), *given(), 16)
    assert babble and babble == generate(load_model(str(random)), *given(), 16)
    with pytest.raises(ValueError, match=r"answer of backend 'vlm': expected one JSON object .* got 0 in") as caught:
        described(random, new_tokens=16)
    assert repr(babble[:200]) in str(caught.value)


def test_prompt_and_image_reach_the_model(random: Path) -> None:
    """Check that the prompt contains task and one image, and that other inputs give other logits."""
    chat, (asked, sheet) = load_model(str(random)), given()
    batch = inputs(chat, asked, sheet)
    prompt = chat.processor.tokenizer.decode(batch["input_ids"][0], skip_special_tokens=True)
    assert prompt.count(f'"{TASK}"') == 1 and prompt.endswith("assistant: ") and batch["pixel_values"].shape == (1, 3, 64, 64)
    logits = [next_word(chat, words, picture) for words, picture in ((asked, sheet), (asked, 255 - sheet), (asked[:-5], sheet))]
    assert all((logits[0] - other).abs().max() > 1e-5 for other in logits[1:])


def next_word(chat: ChatModel, asked: str, sheet: np.ndarray) -> torch.Tensor:
    with torch.inference_mode():
        found: torch.Tensor = chat.model(**inputs(chat, asked, sheet)).logits[0, -1]
    return found


def test_invalid_models_are_refused(random: Path, tmp_path: Path) -> None:
    """Check missing names, folders, processors, templates and tensors, other models, and pickles."""
    backbones = save_backbones(tmp_path / "backbones")
    holed, pickled, silent = (Path(shutil.copytree(random, tmp_path / name)) for name in ("holed", "pickled", "silent"))
    weights = load_file(holed / "model.safetensors")
    fewer = {name: value for name, value in weights.items() if "lm_head" not in name}
    save_file(fewer, holed / "model.safetensors", {"format": "pt"})
    torch.save(weights, pickled / "pytorch_model.bin")
    (pickled / "model.safetensors").unlink()
    model, lack = "expected a vision-language model with its processor", "these lack lm_head"
    (silent / "chat_template.jinja").unlink()
    for name, sentence in (("", "needs a model: set `model`"), ("/nowhere", model), (backbones / "vlm", model), (pickled, model),
                           (backbones / "sam", model), (silent, "with a chat template"), (holed, lack)):  # fmt: skip
        with pytest.raises(ValueError, match=sentence):
            described(name)


def test_chain_with_a_local_model(taught: Path, tmp_path: Path) -> None:
    """Check description, CLIP scores and export; a changed byte of the model reruns the description."""
    chat = Path(shutil.copytree(taught, tmp_path / "chat"))
    clip = save_backbones(tmp_path / "models") / "clip"
    sets = ["part_describe.backend=vlm", f"part_describe.vlm.model={chat}", f"part_describe.tasks={TASK}",
            "mask_score.backend=clip", f"mask_score.clip.model={clip}"]  # fmt: skip
    runner, report = run(tmp_path / "store", sets)
    assert report.ok, report.failures
    told = runner.store.load(content(report, "negative_affordance_files"))
    assert told.files and not run(tmp_path / "store", sets)[1].ran
    (chat / "generation_config.json").write_text((chat / "generation_config.json").read_text() + "\n")
    assert set(run(tmp_path / "store", sets)[1].ran) == {"part_describe"}  # new answer, equal to the old one


def test_failure_of_a_model_leaves_other_stages(tmp_path: Path) -> None:
    """Check that independent stages run, and that other weights give another message."""
    found = []
    for seed in (0, 1):
        sets = ["part_describe.backend=vlm", f"part_describe.vlm.model={save_chat(tmp_path / str(seed), seed=seed)}",
                f"part_describe.tasks={TASK}", "part_describe.vlm.new_tokens=8"]  # fmt: skip
        _, report = run(tmp_path / "store", sets)
        assert report.failures[0].stage == "part_describe" and "mask_propose" in {*report.ran, *report.cached}
        found.append(report.failures[0].message)
    assert found[0] != found[1] and all("answer of backend 'vlm': expected one JSON object" in one for one in found)


def test_chain_with_a_server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Check that answers are cached by their prompt, so that no second run needs the server."""
    plant(monkeypatch)
    clip = save_backbones(tmp_path / "models") / "clip"
    with serving(lambda _: says(GOOD)) as server:
        sets = ["part_describe.backend=endpoint", f"part_describe.endpoint.url={server.url}",
                "part_describe.endpoint.model=some-vlm",
                f"part_describe.endpoint.key_variable={VARIABLE}", f"part_describe.tasks={TASK}", "mask_score.backend=clip",
                f"mask_score.clip.model={clip}"]  # fmt: skip
        assert run(tmp_path / "store", sets)[1].ok and len(server.asked) == 1
    assert not run(tmp_path / "store", sets)[1].ran


def test_changed_weights_are_reloaded(taught: Path, tmp_path: Path) -> None:
    """Check that a model in memory is not used for files that replaced it."""
    chat = Path(shutil.copytree(taught, tmp_path / "chat"))
    before = load_model(str(chat))
    assert load_model(str(chat)) is before
    flip_a_weight(chat / "model.safetensors")
    assert load_model(str(chat)) is not before
