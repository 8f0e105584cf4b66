"""Which samples teach and which ones judge: the data set's own splits, or groups that never meet (videos, objects)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from blake3 import blake3

from afford.dataset.load import Item
from afford.twohands.train import sources

GIVEN, VIDEO, OBJECT = "given", "video", "object"


@dataclass(frozen=True)
class Division:
    """How to divide."""

    by: str = GIVEN
    """given: the splits train and val as they are; video, object: a share of the videos (nouns) of both judges"""
    val_fraction: float = 0.1
    """share of groups that judge, where they are divided here"""
    seed: int = 0

    def __post_init__(self) -> None:
        if self.by not in (GIVEN, VIDEO, OBJECT):
            raise ValueError(f"split_by: expected given, video or object, got {self.by!r}")
        if not 0 < self.val_fraction < 1:
            raise ValueError(f"val_fraction: expected more than 0 and less than 1, got {self.val_fraction}")


def part(files: sources.Files, division: Division, name: str) -> Iterator[Item]:
    """The samples of one part, `train` or `val`, in the order of the files. The split `test` is never touched."""
    found = sources.splits(files)
    if division.by == GIVEN:
        if name not in found:
            raise ValueError(f"data set: expected a split {name}, found {', '.join(found)}; divide it here with split_by=video")
        yield from sources.items(files, name)
        return
    for split in (split for split in found if split != "test"):
        for item in sources.items(files, split):
            if judges(group(item, division.by), division) == (name == "val"):
                yield item


def group(item: Item, by: str) -> str:
    """What a sample must not be parted from. ValueError when the data set does not say."""
    label = item.video if by == VIDEO else item.noun
    if not label:
        raise ValueError(f"{item.sample_id}: expected a {'video' if by == VIDEO else 'noun'} to divide by, found none; "
                         "choose another split_by")
    return label


def judges(label: str, division: Division) -> bool:
    """Whether a group is for validation: decided by the seeded hash of its name alone."""
    digest = blake3(f"{division.seed}:{label}".encode()).digest(7)
    return int.from_bytes(digest, "big") / 2.0**56 < division.val_fraction
