"""Folder of a trained model: config.json, model.safetensors, words.json and, with backbones, their architectures and tokenizer.

No pickle is read. A file with missing, extra or misshaped tensors is refused, and the tensors are named.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path

from blake3 import blake3
from safetensors import SafetensorError
from safetensors.torch import load_file

from afford.common.errors import SourceError
from afford.common.text import swap_sides
from afford.models.importing.source import INDEX, RECORD, shards
from afford.models.loading import CONFIG, WEIGHTS, dtype_of, fill_weights, write_model
from afford.models.word_vectors import split_words
from afford.twohands.model.interface import ModelConfig, TwoHands, build

FORMAT = "afford-twohands-1"
INSIDE = "model"
"""folder of the model inside a published training"""


def save_model(model: TwoHands, folder: Path) -> None:
    """Write a model; equal weights give equal bytes, whatever folder its backbones came from."""
    folder.mkdir(parents=True, exist_ok=True)
    write_model(folder, model, dataclasses.replace(model.config, backbones=""), FORMAT)
    for name, text in model.extra_files().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def config_json(config: ModelConfig) -> str:
    """Text of config.json of a model."""
    fields = {"format": FORMAT, **dataclasses.asdict(dataclasses.replace(config, backbones=""))}
    return json.dumps(fields, indent=2, sort_keys=True) + "\n"


def locate_files(folder: Path) -> Path:
    """Folder of the files of a model: `folder` itself, or `model/` in it for a published training."""
    return folder if (folder / CONFIG).is_file() or not (folder / INSIDE / CONFIG).is_file() else folder / INSIDE


def load_model(folder: Path, dtype: str = "", device: str = "cpu", pictures: int = 1) -> TwoHands:
    """Load a model from a folder of `save_model`, of a published training or of `weights import`, on the CPU, to evaluate it.

    dtype: one of `loading.DTYPES`; '' for single precision, and for `vlm` as it is stored. A `vlm` in the type in which it is
    stored is memory-mapped, and refused where `device`, to which it will be moved, has too little memory for batches of `pictures`
    (`memory_plan`). ValueError names the file, field or tensor that does not fit.
    """
    folder = locate_files(folder)
    config = read_config(folder)
    if config.variant == "vlm":
        from afford.twohands.model.large import load_large

        return load_large(folder, config, dtype, device, pictures)
    try:
        weights = load_file(folder / WEIGHTS)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{folder / WEIGHTS}: expected the weights of a model as safetensors; {error}") from error
    model = build(config, seed=0, pretrained=False)
    if config.variant == "lite":
        from afford.twohands.model.lite import completed

        weights = completed(weights)
    fill_weights(model, weights, str(folder / WEIGHTS), "it is the file of another model")
    return (model.to(dtype_of(dtype)) if dtype else model).eval()


def read_config(folder: Path) -> ModelConfig:
    """Read the config of a saved model; its `backbones` is the folder itself, which holds their architectures."""
    path = folder / CONFIG
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a trained two-hand model; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f"{path}: expected \"format\": \"{FORMAT}\"; write the folder with save_model")
    try:
        config = ModelConfig.from_dict(fields)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error
    return config if config.variant == "small" else dataclasses.replace(config, backbones=str(folder))


VOCABULARY_FILE, VOCABULARY_FORMAT = "words.json", "afford-words-1"
PRESENCE_FILE = "presence.json"
"""file of presence.py, for models that have one"""
FILLERS = frozenset(("a", "an", "and", "at", "by", "for", "from", "in", "into", "it", "my", "of", "off", "on", "onto", "out",
                     "over", "the", "this", "that", "to", "up", "with", "your"))  # fmt: skip
"""words that name neither an object nor an action, so that they are never reported as unknown"""


@dataclass(frozen=True)
class Vocabulary:
    """Words of the tasks that a model was trained on; each tuple is sorted, without duplicates."""

    verbs: tuple[str, ...]
    things: tuple[str, ...]
    words: tuple[str, ...]
    """all words of the tasks, in lower case"""

    def joined(self, other: Vocabulary) -> Vocabulary:
        """Vocabulary with the words of both."""
        return Vocabulary(*(tuple(sorted({*mine, *more})) for mine, more in zip(astuple(self), astuple(other), strict=True)))

    def unknown(self, task: str) -> list[str]:
        """Words of a task that the vocabulary does not contain, without fillers, in the order of the task."""
        known = FILLERS.union(self.words)
        return [word for word in dict.fromkeys(split_words(task)) if word not in known]


def vocabulary_of(samples: Iterable[tuple[str, str, str]]) -> Vocabulary:
    """Vocabulary of samples (task, verb, object), '' where one is not known; mirrored tasks are included."""
    tasks, verbs, things = (sorted(set(column) - {""}) for column in zip(*samples, strict=True))
    words = {word for task in tasks for text in (task, swap_sides(task)) for word in split_words(text)}
    return Vocabulary(tuple(verbs), tuple(things), tuple(sorted(words)))


def write_vocabulary(known: Vocabulary, folder: Path) -> None:
    """Write words.json into the folder of a model."""
    text = json.dumps({"format": VOCABULARY_FORMAT, **dataclasses.asdict(known)}, indent=1) + "\n"
    (folder / VOCABULARY_FILE).write_text(text, encoding="utf-8")


def read_vocabulary(folder: Path) -> Vocabulary | None:
    """Read the vocabulary of the model in a folder; None without words.json. ValueError for a file of another format."""
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
    """A model on disk, with its name and digest."""

    folder: Path
    """folder with config.json and model.safetensors"""
    name: str
    digest: str
    """blake3 of the files that answers depend on: config, weights, vocabulary and presence"""
    words: Vocabulary | None = None
    """vocabulary of its training, if the folder has one"""


def find_model(folder: Path) -> ModelFolder:
    """Find the model in a folder. SourceError when there is no model, ValueError when its words.json cannot be read."""
    place = locate_files(folder)
    for name in (CONFIG, WEIGHTS):
        if not (place / name).is_file() and not (name == WEIGHTS and (place / INDEX).is_file()):
            raise SourceError(str(folder), f"a trained model ({CONFIG} and {WEIGHTS})", f"no {name}", "run `make train` first")
    named = place.resolve()
    return ModelFolder(place, named.parent.name if named.name == INSIDE else named.name, _digest(place), read_vocabulary(place))


def latest_model(models: Path, form: str = FORMAT) -> Path | None:
    """Folder of the model of this format that was published last below `models`; None when there is no such model."""
    found = [path for path in models.glob("[!.]*") if (path / INSIDE / CONFIG).is_file() and format_of(path) == form]
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path.name), default=None)


def format_of(folder: Path) -> str | None:
    """Format that the config of the model in a folder names; None without a config or a format."""
    try:
        fields = json.loads((locate_files(folder) / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return fields.get("format") if isinstance(fields, dict) else None


def _digest(place: Path) -> str:
    record = place / RECORD
    if record.is_file():  # it has the digests of all files, which may be tens of gigabytes
        return blake3(record.read_bytes()).hexdigest()
    digest, weights = blake3(), shards(place / INDEX) if (place / INDEX).is_file() else [place / WEIGHTS]
    beside = [place / name for name in (VOCABULARY_FILE, PRESENCE_FILE) if (place / name).is_file()]
    for path in (place / CONFIG, *weights, *beside):
        digest.update_mmap(path)
    return digest.hexdigest()
