"""Which model answers: a folder as `files.save` wrote it, or one that holds such a folder, and its name and digest."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from blake3 import blake3

from afford.common.errors import SourceError
from afford.twohands.model import files, known
from afford.twohands.model.files import CONFIG, FORMAT, INSIDE, WEIGHTS
from afford.twohands.model.known import KnownWords


@dataclass(frozen=True)
class Stored:
    """A model on disk."""

    folder: Path
    """holds config.json and model.safetensors"""
    name: str
    digest: str
    """blake3 of the config and the weights"""
    words: KnownWords | None = None
    """what its training contained, where it says so"""


def find(folder: Path) -> Stored:
    """The model in a folder. SourceError when there is none, ValueError when its words cannot be read."""
    place = files.place(folder)
    for name in (CONFIG, WEIGHTS):
        if not (place / name).is_file():
            raise SourceError(str(folder), f"a trained model ({CONFIG} and {WEIGHTS})", f"no {name}", "run `make train` first")
    named = place.resolve()
    return Stored(place, named.parent.name if named.name == INSIDE else named.name, _digest(place), known.read(place))


def unknown_words(model: Stored, task: str) -> list[str] | None:
    """Words of a task that the training of a model did not contain; None where the model does not say what it contained."""
    return None if model.words is None else model.words.unknown(task)


def last(models: Path, form: str = FORMAT) -> Path | None:
    """The folder below `models` (models/ of a store) with a model of this format that was published last, None for none."""
    found = [path for path in models.glob("[!.]*") if (path / INSIDE / CONFIG).is_file() and form_of(path) == form]
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path.name), default=None)


def form_of(folder: Path) -> str | None:
    """The format that the config of the model in a folder names; None when there is no such config, or it names none."""
    try:
        fields = json.loads((files.place(folder) / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return fields.get("format") if isinstance(fields, dict) else None


def _digest(place: Path) -> str:
    digest = blake3()
    for name in (CONFIG, WEIGHTS):
        digest.update_mmap(place / name)
    return digest.hexdigest()
