"""A model as a folder: config.json, model.safetensors and, for models with backbones, their architectures and tokenizer.

Nothing is ever unpickled, and nothing is loaded that does not fit: every missing, extra or misshaped tensor is named.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from blake3 import blake3
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from afford.common.errors import SourceError
from afford.common.text import swap_sides
from afford.models.loading import fill_weights
from afford.models.word_vectors import split_words
from afford.twohands.model.interface import ModelConfig, TwoHands, build

CONFIG, WEIGHTS, FORMAT = "config.json", "model.safetensors", "afford-twohands-1"
INSIDE = "model"
"""where a training keeps the model, beside its card and curves"""


def save_model(model: TwoHands, folder: Path) -> None:
    """Write a model; the same weights give the same bytes, wherever its backbones came from."""
    folder.mkdir(parents=True, exist_ok=True)
    own = dataclasses.replace(model.config, backbones="")
    described = {"format": FORMAT, **dataclasses.asdict(own)}
    texts = {CONFIG: json.dumps(described, indent=2, sort_keys=True) + "\n", **model.extra_files()}
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def files_folder(folder: Path) -> Path:
    """Where the files of a model are: the folder itself, or `model/` in what a training published."""
    return folder if (folder / CONFIG).is_file() or not (folder / INSIDE / CONFIG).is_file() else folder / INSIDE


def load_model(folder: Path) -> TwoHands:
    """The model that `save` wrote, or that a training published, on the CPU, in evaluation mode.

    ValueError says which file, field or tensor does not fit.
    """
    folder = files_folder(folder)
    config = read_config(folder)
    try:
        weights = load_file(folder / WEIGHTS)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{folder / WEIGHTS}: expected the weights of a model as safetensors; {error}") from error
    model = build(config, seed=0, pretrained=False)
    fill_weights(model, weights, str(folder / WEIGHTS), "it is the file of another model")
    return model.eval()


def read_config(folder: Path) -> ModelConfig:
    """The config of a saved model, with `backbones` pointing at the architectures beside it."""
    path = folder / CONFIG
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a trained two-hand model; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f"{path}: expected \"format\": \"{FORMAT}\"; write the folder with files.save")
    try:
        config = ModelConfig.from_dict(fields)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error
    return config if config.variant == "small" else dataclasses.replace(config, backbones=str(folder))


VOCABULARY_FILE, VOCABULARY_FORMAT = "words.json", "afford-words-1"
FILLERS = frozenset(("a", "an", "and", "at", "by", "for", "from", "in", "into", "it", "my", "of", "off", "on", "onto", "out",
                     "over", "the", "this", "that", "to", "up", "with", "your"))  # fmt: skip
"""words that name neither a thing nor an action: no warning is needed"""


@dataclass(frozen=True)
class Vocabulary:
    """Each sorted, without doubles."""

    verbs: tuple[str, ...]
    things: tuple[str, ...]
    words: tuple[str, ...]
    """of all tasks, in lower case"""

    def unknown(self, task: str) -> list[str]:
        """Words of a task that are not among them, fillers left out, in their order."""
        known = FILLERS.union(self.words)
        return [word for word in dict.fromkeys(split_words(task)) if word not in known]


def vocabulary_of(samples: Iterable[tuple[str, str, str]]) -> Vocabulary:
    """The vocabulary of samples: task, verb and thing, '' for none. Each task counts as it is and as it is called in a mirror."""
    tasks, verbs, things = (sorted(set(column) - {""}) for column in zip(*samples, strict=True))
    words = {word for task in tasks for said in (task, swap_sides(task)) for word in split_words(said)}
    return Vocabulary(tuple(verbs), tuple(things), tuple(sorted(words)))


def write_vocabulary(known: Vocabulary, folder: Path) -> None:
    """Write words.json into the folder of a model."""
    text = json.dumps({"format": VOCABULARY_FORMAT, **dataclasses.asdict(known)}, indent=1) + "\n"
    (folder / VOCABULARY_FILE).write_text(text, encoding="utf-8")


def read_vocabulary(folder: Path) -> Vocabulary | None:
    """The vocabulary of the model in a folder, None where its training left none. ValueError for a file of another form."""
    path = folder / VOCABULARY_FILE
    if not path.exists():
        return None
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
        lists = [fields[name] for name in ("verbs", "things", "words")] if fields["format"] == VOCABULARY_FORMAT else [[None]]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise ValueError(f"{path}: expected a list of known words, got another file ({error}); train again") from error
    if not all(isinstance(one, list) and all(isinstance(word, str) for word in one) for one in lists):
        raise ValueError(f"{path}: expected \"format\": \"{VOCABULARY_FORMAT}\" and lists of words, got something else; "
                         "train again")
    return Vocabulary(*map(tuple, lists))


@dataclass(frozen=True)
class ModelFolder:
    """A model on disk."""

    folder: Path
    """holds config.json and model.safetensors"""
    name: str
    digest: str
    """blake3 of the config and the weights"""
    words: Vocabulary | None = None
    """what its training contained, where it says so"""


def find_model(folder: Path) -> ModelFolder:
    """The model in a folder. SourceError when there is none, ValueError when its words cannot be read."""
    place = files_folder(folder)
    for name in (CONFIG, WEIGHTS):
        if not (place / name).is_file():
            raise SourceError(str(folder), f"a trained model ({CONFIG} and {WEIGHTS})", f"no {name}", "run `make train` first")
    named = place.resolve()
    return ModelFolder(place, named.parent.name if named.name == INSIDE else named.name, _digest(place), read_vocabulary(place))


def unknown_words(model: ModelFolder, task: str) -> list[str] | None:
    """Words of a task that the training of a model did not contain; None where the model does not say what it contained."""
    return None if model.words is None else model.words.unknown(task)


def latest_model(models: Path, form: str = FORMAT) -> Path | None:
    """The folder below `models` (models/ of a store) with a model of this format that was published last, None for none."""
    found = [path for path in models.glob("[!.]*") if (path / INSIDE / CONFIG).is_file() and format_of(path) == form]
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path.name), default=None)


def format_of(folder: Path) -> str | None:
    """The format that the config of the model in a folder names; None when there is no such config, or it names none."""
    try:
        fields = json.loads((files_folder(folder) / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return fields.get("format") if isinstance(fields, dict) else None


def _digest(place: Path) -> str:
    digest = blake3()
    for name in (CONFIG, WEIGHTS):
        digest.update_mmap(place / name)
    return digest.hexdigest()
