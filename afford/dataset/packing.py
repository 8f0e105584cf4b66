"""Which video belongs to which split. A video, or a participant, is never in two."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from blake3 import blake3

from afford.codecs.kinds import digest
from afford.common import files
from afford.dataset import contact_sheet, metadata, parquet_shards, table_schema
from afford.dataset.metadata import licence_of
from afford.dataset.statistics import DatasetCounts, statistics, write_plots
from schemas.affordance import Samples


@dataclass(frozen=True)
class SplitRule:
    """How splits are made where the source has none."""

    by: str
    val_fraction: float
    test_fraction: float
    seed: int

    def __post_init__(self) -> None:
        if self.by not in ("video", "participant"):
            raise ValueError(f"split_by: expected 'video' or 'participant', got {self.by!r}")
        if min(self.val_fraction, self.test_fraction) < 0 or self.val_fraction + self.test_fraction > 1:
            raise ValueError(f"val_fraction and test_fraction: expected at least 0 and at most 1 together, "
                             f"got {self.val_fraction} and {self.test_fraction}")


def assign_splits(clips: Iterable[Samples], rule: SplitRule) -> dict[str, str]:
    """Split of every video id: the source's when it names one for every video, else by a seeded hash of the group.

    The hash decides for each group alone, so a video keeps its split when others come or go. When none would be left to
    train on, the group with the largest hash is.
    """
    said: dict[str, str] = {}
    groups: dict[str, str] = {}
    for clip in clips:
        groups[clip.video_id] = clip.video_id if rule.by == "video" else clip.participant_id
        if said.setdefault(clip.video_id, clip.split) != clip.split:
            raise ValueError(f"{clip.video_id}: its clips are in the splits {said[clip.video_id]!r} and {clip.split!r}; "
                             "a video belongs to one split, correct the source")
    return said if all(said.values()) else _by_hash(groups, rule)


def _by_hash(groups: dict[str, str], rule: SplitRule) -> dict[str, str]:
    place = {group: _hash_position(rule.seed, group) for group in groups.values()}
    split = {group: _split_name(at, rule) for group, at in place.items()}
    if "train" not in split.values():
        split[max(place, key=place.__getitem__)] = "train"
    return {video: split[group] for video, group in groups.items()}


def _hash_position(seed: int, group: str) -> float:
    """Uniform in [0, 1)."""
    return int.from_bytes(blake3(f"{seed}:{group}".encode()).digest(7), "big") / 2.0**56


def _split_name(place: float, rule: SplitRule) -> str:
    if place < rule.test_fraction:
        return "test"
    return "val" if place < rule.test_fraction + rule.val_fraction else "train"


SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class ClipSummary:
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
class PackPlan:
    """What the first pass finds out: the classes, and which clips go into which split."""

    heads: tuple[ClipSummary, ...]
    """by video and clip"""
    verbs: table_schema.Classes
    nouns: table_schema.Classes
    split: dict[str, str]
    samples: Counter[str]
    """samples per split"""

    def splits(self) -> list[str]:
        """The splits that have samples, in the usual order, others after them."""
        known = [name for name in SPLITS if name in self.samples]
        return known + sorted(set(self.samples) - set(SPLITS))


def plan_pack(clips: Sequence[Samples], rule: SplitRule) -> PackPlan:
    """First pass. ValueError when there is no sample, or when two have the same id."""
    found = (_summarize(index, clip) for index, clip in enumerate(clips))
    heads = tuple(_drop_shared_frames(sorted(found, key=lambda head: (head.clip.video_id, head.clip.clip_id))))
    split = assign_splits((head.clip for head in heads), rule)
    samples: Counter[str] = Counter()
    for head in heads:
        samples[split[head.clip.video_id]] += len(head.ids)
    if not samples.total():
        raise ValueError(f"no clip gives a sample, so there is no data set to write; {_rejection_summary(heads)}")
    _check_ids(heads)
    verbs = table_schema.collect_classes(pair for head in heads for pair in head.verbs)
    nouns = table_schema.collect_classes(pair for head in heads for pair in head.nouns)
    return PackPlan(heads, verbs, nouns, split, +samples)


def _drop_shared_frames(heads: Iterable[ClipSummary]) -> Iterator[ClipSummary]:
    """Two parts of one video share the key frame at which it was cut: the last of the one, the first of the other. The earlier
    part gives its samples.
    """
    last: dict[str, int] = {}
    for head in heads:
        shared = last.get(head.clip.video_id)
        keep = [i for i, frame in enumerate(head.frames) if frame != shared]
        yield replace(head, ids=tuple(head.ids[i] for i in keep))
        last[head.clip.video_id] = max(head.frames, default=-1)


def _summarize(index: int, clip: Samples) -> ClipSummary:
    found = [(sample.sample_id, sample.frame, sample.narration) for sample in clip.samples]
    return ClipSummary(index, replace(clip, samples=()), tuple(name for name, _, _ in found), tuple(frame for _, frame, _ in found),
                frozenset((said.verb_key, said.verb_class) for _, _, said in found),
                frozenset((said.noun_key, said.noun_class) for _, _, said in found))


def _rejection_summary(heads: Iterable[ClipSummary]) -> str:
    reasons: Counter[str] = Counter()
    for head in heads:
        reasons.update(dict(head.clip.rejected))
    frames = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
    return f"frames left out: {frames}" if frames else "there was no frame at all"


def _check_ids(heads: Iterable[ClipSummary]) -> None:
    seen = Counter(name for head in heads for name in head.ids)
    name, count = seen.most_common(1)[0]
    if count > 1:
        raise ValueError(f"sample_id {name!r}: expected once, found {count} times; two clips cover the same frame")


@dataclass
class SampleWriter:
    """Second pass: rows of one split after the other, counted, and a few of them kept for the contact sheet."""

    clips: Sequence[Samples]
    plan: PackPlan
    wanted: frozenset[int]
    progress: Callable[[int, int], None]
    tally: DatasetCounts = field(default_factory=DatasetCounts)
    kept: list[dict[str, Any]] = field(default_factory=list)

    def rows(self, split: str) -> Iterator[dict[str, Any]]:
        """The rows of one split, by video, clip and frame."""
        verbs, nouns = self.plan.verbs.labels(), self.plan.nouns.labels()
        for head in self.plan.heads:
            if self.plan.split[head.clip.video_id] == split and head.ids:
                clip = self.clips[head.index]
                provenance, wanted = digest(clip), set(head.ids)
                for sample in (sample for sample in clip.samples if sample.sample_id in wanted):
                    row = table_schema.table_row(clip, sample, verbs, nouns, provenance)
                    self._note(split, sample, row)
                    yield row

    def _note(self, split: str, sample: Any, row: dict[str, Any]) -> None:
        done = self.tally.splits.total()
        if done in self.wanted:
            self.kept.append(row)
        self.tally.add(split, sample, row)
        self.progress(done + 1, self.plan.samples.total())


def write_samples(root: Path, clips: Sequence[Samples], made: PackPlan, per_shard: int, pictures: int,
                  progress: Callable[[int, int], None]) -> SampleWriter:
    """Write the Parquet shards of every split; returns what was counted and kept on the way."""
    writing = SampleWriter(clips, made, frozenset(contact_sheet.evenly_spaced(made.samples.total(), pictures)), progress)
    schema = table_schema.arrow_schema(table_schema.columns(made.verbs, made.nouns))
    for split in made.splits():
        names = parquet_shards.shard_names(split, made.samples[split], per_shard)
        parquet_shards.write_shards(writing.rows(split), schema, root, names, per_shard)
    return writing


def write_metadata(root: Path, writing: SampleWriter, name: str, licence: str, version: str, how: str) -> None:
    """Everything that stands beside the shards: statistics, plots, contact sheet, card, Croissant, manifest."""
    made = writing.plan
    licence = licence_of(made.split, licence)
    table = table_schema.columns(made.verbs, made.nouns)
    numbers = statistics(writing.tally, [head.clip for head in made.heads], made.verbs, made.nouns)
    files.write_json(root / "statistics.json", numbers)
    write_plots(root, writing.tally, numbers)
    contact_sheet.write_sheet(root / "contact_sheet.png", writing.kept)
    (root / "README.md").write_text(metadata.dataset_card(name, licence, numbers, table, how), encoding="utf-8", newline="\n")
    parquet = [file for file in files.names(root) if file.endswith(".parquet")]
    files.write_json(root / "croissant.json", metadata.croissant(name, licence, version, table, root, parquet))
    files.write_manifest(root)
