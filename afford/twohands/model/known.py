"""Vocabulary of a training: the words of its tasks, kept beside the weights. A small model reads other words by letters alone."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from afford.common.text import swap_sides
from afford.models.words import split

FILE, FORMAT = "words.json", "afford-words-1"
FILLERS = frozenset(("a", "an", "and", "at", "by", "for", "from", "in", "into", "it", "my", "of", "off", "on", "onto", "out",
                     "over", "the", "this", "that", "to", "up", "with", "your"))  # fmt: skip
"""words that name neither a thing nor an action: no warning is needed"""


@dataclass(frozen=True)
class KnownWords:
    """Each sorted, without doubles."""

    verbs: tuple[str, ...]
    things: tuple[str, ...]
    words: tuple[str, ...]
    """of all tasks, in lower case"""

    def unknown(self, task: str) -> list[str]:
        """Words of a task that are not among them, fillers left out, in their order."""
        known = FILLERS.union(self.words)
        return [word for word in dict.fromkeys(split(task)) if word not in known]


def of(samples: Iterable[tuple[str, str, str]]) -> KnownWords:
    """The vocabulary of samples: task, verb and thing, '' for none. Each task counts as it is and as it is called in a mirror."""
    tasks, verbs, things = (sorted(set(column) - {""}) for column in zip(*samples, strict=True))
    words = {word for task in tasks for said in (task, swap_sides(task)) for word in split(said)}
    return KnownWords(tuple(verbs), tuple(things), tuple(sorted(words)))


def write(known: KnownWords, folder: Path) -> None:
    """Write words.json into the folder of a model."""
    (folder / FILE).write_text(json.dumps({"format": FORMAT, **dataclasses.asdict(known)}, indent=1) + "\n", encoding="utf-8")


def read(folder: Path) -> KnownWords | None:
    """The vocabulary of the model in a folder, None where its training left none. ValueError for a file of another form."""
    path = folder / FILE
    if not path.exists():
        return None
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
        lists = [fields[name] for name in ("verbs", "things", "words")] if fields["format"] == FORMAT else [[None]]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise ValueError(f"{path}: expected a list of known words, got another file ({error}); train again") from error
    if not all(isinstance(one, list) and all(isinstance(word, str) for word in one) for one in lists):
        raise ValueError(f"{path}: expected \"format\": \"{FORMAT}\" and lists of words, got something else; train again")
    return KnownWords(*map(tuple, lists))
