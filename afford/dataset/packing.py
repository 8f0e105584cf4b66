"""Packing of samples into a data set folder, in two passes: plan classes and splits, then stream the rows into shards.

Clips are taken by index and their samples are iterated one at a time, so memory use does not grow with the data set. A video,
or a participant, is in one split only.
"""

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
    """Rule of the split where the source has none."""

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
    """Assign a split to every video id: the source's when it names one for every video, else by a seeded hash of the group.

    The hash decides for each group independently, so a video keeps its split when others are added or removed. When no group is
    in train, the group with the largest hash moves there.
    """
    stated: dict[str, str] = {}
    groups: dict[str, str] = {}
    for clip in clips:
        groups[clip.video_id] = clip.video_id if rule.by == "video" else clip.participant_id
        if stated.setdefault(clip.video_id, clip.split) != clip.split:
            raise ValueError(f"{clip.video_id}: its clips are in the splits {stated[clip.video_id]!r} and {clip.split!r}; "
                             "a video belongs to one split, correct the source")
    return stated if all(stated.values()) else _by_hash(groups, rule)


def _by_hash(groups: dict[str, str], rule: SplitRule) -> dict[str, str]:
    place = {group: _hash_position(rule.seed, group) for group in groups.values()}
    split = {group: _split_name(at, rule) for group, at in place.items()}
    if "train" not in split.values():
        split[max(place, key=place.__getitem__)] = "train"
    return {video: split[group] for video, group in groups.items()}


def _hash_position(seed: int, group: str) -> float:
    """Hash a group uniformly to [0, 1)."""
    return int.from_bytes(blake3(f"{seed}:{group}".encode()).digest(7), "big") / 2.0**56


def _split_name(place: float, rule: SplitRule) -> str:
    if place < rule.test_fraction:
        return "test"
    return "val" if place < rule.test_fraction + rule.val_fraction else "train"


SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class ClipSummary:
    """Summary of a clip from the first pass."""

    index: int
    clip: Samples
    """the clip without its samples"""
    ids: tuple[str, ...]
    frames: tuple[int, ...]
    """frame number of every sample of the clip"""
    verbs: frozenset[tuple[str, int]]
    nouns: frozenset[tuple[str, int]]


@dataclass(frozen=True)
class PackPlan:
    """Result of the first pass: the classes, and the split of every video."""

    summaries: tuple[ClipSummary, ...]
    """sorted by video and clip"""
    verbs: table_schema.Classes
    nouns: table_schema.Classes
    split: dict[str, str]
    samples: Counter[str]
    """number of samples of each split"""

    def splits(self) -> list[str]:
        """Return the splits that have samples: train, val, test, then others."""
        known = [name for name in SPLITS if name in self.samples]
        return known + sorted(set(self.samples) - set(SPLITS))


def plan_pack(clips: Sequence[Samples], rule: SplitRule) -> PackPlan:
    """Run the first pass. Raises ValueError when there is no sample, or two samples have the same id."""
    found = (_summarize(index, clip) for index, clip in enumerate(clips))
    summaries = tuple(_drop_shared_frames(sorted(found, key=lambda summary: (summary.clip.video_id, summary.clip.clip_id))))
    split = assign_splits((summary.clip for summary in summaries), rule)
    samples: Counter[str] = Counter()
    for summary in summaries:
        samples[split[summary.clip.video_id]] += len(summary.ids)
    if not samples.total():
        raise ValueError(f"no clip gives a sample, so there is no data set to write; {_rejection_summary(summaries)}")
    _check_ids(summaries)
    verbs = table_schema.collect_classes(pair for summary in summaries for pair in summary.verbs)
    nouns = table_schema.collect_classes(pair for summary in summaries for pair in summary.nouns)
    return PackPlan(summaries, verbs, nouns, split, +samples)


def _drop_shared_frames(summaries: Iterable[ClipSummary]) -> Iterator[ClipSummary]:
    """Drop the duplicate of the key frame that two parts of one video share; the earlier part keeps it."""
    last: dict[str, int] = {}
    for summary in summaries:
        shared = last.get(summary.clip.video_id)
        keep = [i for i, frame in enumerate(summary.frames) if frame != shared]
        yield replace(summary, ids=tuple(summary.ids[i] for i in keep))
        last[summary.clip.video_id] = max(summary.frames, default=-1)


def _summarize(index: int, clip: Samples) -> ClipSummary:
    found = [(sample.sample_id, sample.frame, sample.narration) for sample in clip.samples]
    return ClipSummary(index, replace(clip, samples=()), tuple(name for name, _, _ in found), tuple(frame for _, frame, _ in found),
                frozenset((narration.verb_key, narration.verb_class) for _, _, narration in found),
                frozenset((narration.noun_key, narration.noun_class) for _, _, narration in found))


def _rejection_summary(summaries: Iterable[ClipSummary]) -> str:
    reasons: Counter[str] = Counter()
    for summary in summaries:
        reasons.update(dict(summary.clip.rejected))
    frames = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
    return f"frames left out: {frames}" if frames else "there was no frame at all"


def _check_ids(summaries: Iterable[ClipSummary]) -> None:
    seen = Counter(name for summary in summaries for name in summary.ids)
    name, count = seen.most_common(1)[0]
    if count > 1:
        raise ValueError(f"sample_id {name!r}: expected once, found {count} times; two clips cover the same frame")


@dataclass
class SampleWriter:
    """Second pass: streams the rows of each split, counts them, and keeps a few for the contact sheet."""

    clips: Sequence[Samples]
    plan: PackPlan
    wanted: frozenset[int]
    progress: Callable[[int, int], None]
    counts: DatasetCounts = field(default_factory=DatasetCounts)
    kept: list[dict[str, Any]] = field(default_factory=list)

    def rows(self, split: str) -> Iterator[dict[str, Any]]:
        """Yield the rows of one split, by video, clip and frame."""
        verbs, nouns = self.plan.verbs.labels(), self.plan.nouns.labels()
        for summary in self.plan.summaries:
            if self.plan.split[summary.clip.video_id] == split and summary.ids:
                clip = self.clips[summary.index]
                provenance, wanted = digest(clip), set(summary.ids)
                for sample in (sample for sample in clip.samples if sample.sample_id in wanted):
                    row = table_schema.table_row(clip, sample, verbs, nouns, provenance)
                    self._note(split, sample, row)
                    yield row

    def _note(self, split: str, sample: Any, row: dict[str, Any]) -> None:
        done = self.counts.splits.total()
        if done in self.wanted:
            self.kept.append(row)
        self.counts.add(split, sample, row)
        self.progress(done + 1, self.plan.samples.total())


def write_samples(root: Path, clips: Sequence[Samples], plan: PackPlan, per_shard: int, pictures: int,
                  progress: Callable[[int, int], None]) -> SampleWriter:
    """Write the Parquet shards of every split; return the writer with its counts and kept rows."""
    writer = SampleWriter(clips, plan, frozenset(contact_sheet.evenly_spaced(plan.samples.total(), pictures)), progress)
    schema = table_schema.arrow_schema(table_schema.columns(plan.verbs, plan.nouns))
    for split in plan.splits():
        names = parquet_shards.shard_names(split, plan.samples[split], per_shard)
        parquet_shards.write_shards(writer.rows(split), schema, root, names, per_shard)
    return writer


def write_metadata(root: Path, writer: SampleWriter, name: str, licence: str, version: str, method: str) -> None:
    """Write statistics, plots, contact sheet, card, Croissant and manifest."""
    plan = writer.plan
    licence = licence_of(plan.split, licence)
    table = table_schema.columns(plan.verbs, plan.nouns)
    numbers = statistics(writer.counts, [summary.clip for summary in plan.summaries], plan.verbs, plan.nouns)
    files.write_json(root / "statistics.json", numbers)
    write_plots(root, writer.counts, numbers)
    contact_sheet.write_sheet(root / "contact_sheet.png", writer.kept)
    (root / "README.md").write_text(metadata.dataset_card(name, licence, numbers, table, method), encoding="utf-8", newline="\n")
    parquet = [file for file in files.names(root) if file.endswith(".parquet")]
    files.write_json(root / "croissant.json", metadata.croissant(name, licence, version, table, root, parquet))
    files.write_manifest(root)
