"""Which video belongs to which split. A video, or a participant, is never in two."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from blake3 import blake3

from schemas.affordance import Samples


@dataclass(frozen=True)
class Rule:
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


def assign(clips: Iterable[Samples], rule: Rule) -> dict[str, str]:
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


def _by_hash(groups: dict[str, str], rule: Rule) -> dict[str, str]:
    place = {group: _place(rule.seed, group) for group in groups.values()}
    split = {group: _name(at, rule) for group, at in place.items()}
    if "train" not in split.values():
        split[max(place, key=place.__getitem__)] = "train"
    return {video: split[group] for video, group in groups.items()}


def _place(seed: int, group: str) -> float:
    """Uniform in [0, 1)."""
    return int.from_bytes(blake3(f"{seed}:{group}".encode()).digest(7), "big") / 2.0**56


def _name(place: float, rule: Rule) -> str:
    if place < rule.test_fraction:
        return "test"
    return "val" if place < rule.test_fraction + rule.val_fraction else "train"
