"""Samples of all clips -> the folder of a data set. Two passes: one over the words, one that writes rows as they come.

Clips are taken by index and their samples walked one at a time and never kept: what the store hands over stays on disk until
then, so that a data set of any size is written in little memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from afford.codecs.identity import digest
from afford.common import files
from afford.dataset import card, classes, columns, croissant, plots, rows, shards, sheet
from afford.dataset.licence import licence_of
from afford.dataset.split import Rule, assign
from afford.dataset.tally import Tally, statistics
from schemas.affordance import Samples

SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class Head:
    """What the first pass keeps of a clip."""

    index: int
    clip: Samples
    """the clip without its samples"""
    ids: tuple[str, ...]
    frames: tuple[int, ...]
    """frame of every sample of the clip"""
    verbs: frozenset[tuple[str, int]]
    nouns: frozenset[tuple[str, int]]


@dataclass(frozen=True)
class Plan:
    """What the first pass finds out: the classes, and which clips go into which split."""

    heads: tuple[Head, ...]
    """by video and clip"""
    verbs: classes.Classes
    nouns: classes.Classes
    split: dict[str, str]
    samples: Counter[str]
    """samples per split"""

    def splits(self) -> list[str]:
        """The splits that have samples, in the usual order, others after them."""
        known = [name for name in SPLITS if name in self.samples]
        return known + sorted(set(self.samples) - set(SPLITS))


def plan(clips: Sequence[Samples], rule: Rule) -> Plan:
    """First pass. ValueError when there is no sample, or when two have the same id."""
    found = (_head(index, clip) for index, clip in enumerate(clips))
    heads = tuple(_once(sorted(found, key=lambda head: (head.clip.video_id, head.clip.clip_id))))
    split = assign((head.clip for head in heads), rule)
    samples: Counter[str] = Counter()
    for head in heads:
        samples[split[head.clip.video_id]] += len(head.ids)
    if not samples.total():
        raise ValueError(f"no clip gives a sample, so there is no data set to write; {_why_none(heads)}")
    _check_ids(heads)
    verbs = classes.emerge(pair for head in heads for pair in head.verbs)
    nouns = classes.emerge(pair for head in heads for pair in head.nouns)
    return Plan(heads, verbs, nouns, split, +samples)


def _once(heads: Iterable[Head]) -> Iterator[Head]:
    """Two parts of one video share the key frame at which it was cut: the last of the one, the first of the other. The earlier
    part gives its samples.
    """
    last: dict[str, int] = {}
    for head in heads:
        shared = last.get(head.clip.video_id)
        keep = [i for i, frame in enumerate(head.frames) if frame != shared]
        yield replace(head, ids=tuple(head.ids[i] for i in keep))
        last[head.clip.video_id] = max(head.frames, default=-1)


def _head(index: int, clip: Samples) -> Head:
    found = [(sample.sample_id, sample.frame, sample.narration) for sample in clip.samples]
    return Head(index, replace(clip, samples=()), tuple(name for name, _, _ in found), tuple(frame for _, frame, _ in found),
                frozenset((said.verb_key, said.verb_class) for _, _, said in found),
                frozenset((said.noun_key, said.noun_class) for _, _, said in found))


def _why_none(heads: Iterable[Head]) -> str:
    reasons: Counter[str] = Counter()
    for head in heads:
        reasons.update(dict(head.clip.rejected))
    frames = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
    return f"frames left out: {frames}" if frames else "there was no frame at all"


def _check_ids(heads: Iterable[Head]) -> None:
    seen = Counter(name for head in heads for name in head.ids)
    name, count = seen.most_common(1)[0]
    if count > 1:
        raise ValueError(f"sample_id {name!r}: expected once, found {count} times; two clips cover the same frame")


@dataclass
class Writing:
    """Second pass: rows of one split after the other, counted, and a few of them kept for the contact sheet."""

    clips: Sequence[Samples]
    plan: Plan
    wanted: frozenset[int]
    progress: Callable[[int, int], None]
    tally: Tally = field(default_factory=Tally)
    kept: list[dict[str, Any]] = field(default_factory=list)

    def rows(self, split: str) -> Iterator[dict[str, Any]]:
        """The rows of one split, by video, clip and frame."""
        verbs, nouns = self.plan.verbs.labels(), self.plan.nouns.labels()
        for head in self.plan.heads:
            if self.plan.split[head.clip.video_id] == split and head.ids:
                clip = self.clips[head.index]
                provenance, wanted = digest(clip), set(head.ids)
                for sample in (sample for sample in clip.samples if sample.sample_id in wanted):
                    row = rows.row(clip, sample, verbs, nouns, provenance)
                    self._note(split, sample, row)
                    yield row

    def _note(self, split: str, sample: Any, row: dict[str, Any]) -> None:
        done = self.tally.splits.total()
        if done in self.wanted:
            self.kept.append(row)
        self.tally.add(split, sample, row)
        self.progress(done + 1, self.plan.samples.total())


def write_samples(root: Path, clips: Sequence[Samples], made: Plan, per_shard: int, pictures: int,
                  progress: Callable[[int, int], None]) -> Writing:
    """Write the Parquet shards of every split; returns what was counted and kept on the way."""
    writing = Writing(clips, made, frozenset(sheet.spread(made.samples.total(), pictures)), progress)
    schema = columns.arrow_schema(columns.columns(made.verbs, made.nouns))
    for split in made.splits():
        names = shards.shard_names(split, made.samples[split], per_shard)
        shards.write(writing.rows(split), schema, root, names, per_shard)
    return writing


def describe(root: Path, writing: Writing, name: str, licence: str, version: str, how: str) -> None:
    """Everything that stands beside the shards: statistics, plots, contact sheet, card, Croissant, manifest."""
    made = writing.plan
    licence = licence_of(made.split, licence)
    table = columns.columns(made.verbs, made.nouns)
    numbers = statistics(writing.tally, [head.clip for head in made.heads], made.verbs, made.nouns)
    files.write_json(root / "statistics.json", numbers)
    plots.write(root, writing.tally, numbers)
    sheet.write(root / "contact_sheet.png", writing.kept)
    (root / "README.md").write_text(card.text(name, licence, numbers, table, how), encoding="utf-8", newline="\n")
    parquet = [file for file in files.names(root) if file.endswith(".parquet")]
    files.write_json(root / "croissant.json", croissant.describe(name, licence, version, table, root, parquet))
    files.write_manifest(root)
