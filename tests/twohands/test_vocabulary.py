"""Words that a training contained: what is unknown, on disk and back, and where a user meets the warning."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from afford.twohands import prediction_files
from afford.twohands.model import model_folder
from afford.twohands.model.model_folder import Vocabulary
from tests.helpers import tiny_asked
from tests.helpers.command import call

KNOWN = model_folder.vocabulary_of([("Pour tea from kettle", "pour", "kettle"), ("cut bread", "cut", "bread"),
                                    ("cut  Bread!", "cut", "bread")])  # fmt: skip


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with words."""
    folder = tiny_asked.write_model(tmp_path_factory.mktemp("store") / "models" / "small" / "model")
    model_folder.write_vocabulary(KNOWN, folder)
    return folder


def test_samples_give_verbs_things_and_words() -> None:
    """Each once, in order; a training mirrors pictures, and with them left and right."""
    assert model_folder.vocabulary_of([("use the left hand", "use", "")]).words == ("hand", "left", "right", "the", "use")
    assert Vocabulary(("cut", "pour"), ("bread", "kettle"), ("bread", "cut", "from", "kettle", "pour", "tea")) == KNOWN


@pytest.mark.parametrize(("task", "unknown"), [
    ("pour tea from kettle", []), ("Pour the tea, into my KETTLE!", []), ("pour zorgblatt", ["zorgblatt"]),
    ("zorgblatt, ZORGBLATT and quux", ["zorgblatt", "quux"]), ("", []), ("verser le thé", ["verser", "le", "thé"]),
])  # fmt: skip
def test_a_word_of_no_task_is_unknown(task: str, unknown: list[str]) -> None:
    """Unknown words are listed once, in the order of the task, without articles and prepositions."""
    assert KNOWN.unknown(task) == unknown


def test_words_lie_beside_the_weights(tmp_path: Path) -> None:
    """The same again, to the byte; none where there are none."""
    assert model_folder.read_vocabulary(tmp_path) is None
    model_folder.write_vocabulary(KNOWN, tmp_path)
    before = (tmp_path / model_folder.VOCABULARY_FILE).read_bytes()
    found = model_folder.read_vocabulary(tmp_path)
    assert found == KNOWN
    model_folder.write_vocabulary(found, tmp_path)
    assert (tmp_path / model_folder.VOCABULARY_FILE).read_bytes() == before


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "other"}', '{"format": "afford-words-1", "verbs": 3}', "[" * 10000,
                                  '{"format": "afford-words-1", "verbs": [1], "things": [], "words": []}', "\xff"])  # fmt: skip
def test_a_damaged_file_is_named(text: str, model: Path, tmp_path: Path) -> None:
    """The error is one sentence; exit 2."""
    folder = tmp_path / "model"
    folder.mkdir()
    for path in model.iterdir():
        (folder / path.name).write_bytes(path.read_bytes() if path.name != model_folder.VOCABULARY_FILE else text.encode("latin-1"))
    image = tiny_asked.write_picture(tmp_path / "kettle.png")
    refused = call("predict", image, "cut", "--out", tmp_path / "out", "--model", folder)
    assert refused.code == 2 and "words.json: expected" in refused.words and "Traceback" not in refused.err


def test_predict_warns_of_unknown_words(model: Path, tmp_path: Path) -> None:
    """Unknown words are on the terminal, in the summary and in the record; known words are not."""
    image = tiny_asked.write_picture(tmp_path / "kettle.png")
    done = call("predict", image, "pour zorgblatt", "--out", tmp_path / "out", "--model", model, "--json")
    assert done.code == 0 and done.json["unknown_words"] == ["zorgblatt"]
    assert "unknown words zorgblatt: this model was not trained with them" in done.words
    assert json.loads((tmp_path / "out" / "kettle" / "prediction.json").read_text())["unknown_words"] == ["zorgblatt"]
    done = call("predict", image, "pour tea", "--out", tmp_path / "out", "--model", model, "--json")
    assert done.json["unknown_words"] == [] and "unknown words" not in done.words


def test_predict_names_what_is_looked_for_by_class(model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The two things that are looked for, where the model has classes; a third one and other unknown words still warn."""
    image, found = tiny_asked.write_picture(tmp_path / "kettle.png"), model_folder.read_config(model)
    for classes, wanted in ((True, ["banana", "lemons"]), (False, [])):
        monkeypatch.setattr(prediction_files, "read_config", lambda _, classes=classes: replace(found, classes=classes))
        task, out = "peel zorgblatt banana, lemons and apple", tmp_path / f"out{classes}"
        done = call("predict", image, task, "--out", out, "--model", model, "--json")
        assert done.json["looked_for"] == wanted and "banana" in done.json["unknown_words"]
        assert ("looked for banana" in done.words) is classes
        warned = done.words.partition("unknown words")[2].partition(":")[0]
        assert "zorgblatt" in warned and "apple" in warned and ("banana" in warned) is not classes
        record = json.loads((out / "kettle" / "prediction.json").read_text())
        assert record["looked_for"] == wanted


def test_a_model_without_words_claims_nothing(tmp_path: Path) -> None:
    """null, which is not the same as none."""
    folder, image = tiny_asked.write_model(tmp_path / "model"), tiny_asked.write_picture(tmp_path / "kettle.png")
    done = call("predict", image, "pour zorgblatt", "--out", tmp_path / "out", "--model", folder, "--json")
    assert done.code == 0 and done.json["unknown_words"] is None and "unknown words" not in done.words
