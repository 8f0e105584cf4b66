"""Warnings of a run about corrected, omitted or doubtful input, collected from the outputs of its stages.

Warnings are part of the outputs, or follow from them, so that a fully cached run shows them as well.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape

from afford.extraction.sources.remarks import aspect_remark, no_hands_remark
from runner import LostError, Runner, RunReport
from schemas.video import NOT_IN_CONTACT, UNKNOWN_CONTACT

SHOWN = 3
"""warnings listed per video and stage"""
LONGEST = 40
"""lines"""
VALUE = "value.json"
Fields = dict[str, Any]
"""fields of a stored value; arrays are references with their shapes"""


@dataclass(frozen=True)
class StageWarning:
    """A correction, an omission or a doubt of a stage."""

    stage: str
    shard: str
    text: str


def show_warnings(runner: Runner, report: RunReport) -> list[StageWarning]:
    """Print the number of warnings of a run, and the first of each video; return all of them."""
    found = gather(runner, report)
    if found:
        console, lines = Console(stderr=True), list(_lines(found))
        console.print(f"[yellow]{len(found)} warning(s)[/]", highlight=False)
        for line in lines[:LONGEST]:
            console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)
        if len(lines) > LONGEST:
            console.print(f"  and {len(lines) - LONGEST} more lines; `pipeline.py check` lists all of a source", highlight=False)
    return found


def gather(runner: Runner, report: RunReport) -> list[StageWarning]:
    """Warnings of the clips of a run, without duplicates, by video."""
    outputs = _Outputs(runner, report)
    found = (warned for video in outputs.shards("source_read") for warned in _of_video(outputs, video))
    return list(dict.fromkeys(found))


def _lines(found: Iterable[StageWarning]) -> Iterator[str]:
    groups: dict[tuple[str, str], list[str]] = {}
    for warned in found:
        groups.setdefault((warned.stage, warned.shard), []).append(warned.text)
    for (stage, shard), texts in groups.items():
        yield from (f"{stage} {shard}: {text}" for text in texts[:SHOWN])
        if len(texts) > SHOWN:
            yield f"{stage} {shard}: and {len(texts) - SHOWN} more"


def _of_video(outputs: _Outputs, video: str) -> Iterator[StageWarning]:
    try:
        for name, digest in outputs.clips(video):
            clip = outputs.fields(digest)
            masks = [mask for key in map(_plain, clip["key_frames"]) for mask in map(_plain, key["annotations"])]
            none = no_hands_remark((mask["side"], mask["name"]) for mask in masks)
            yield from (StageWarning("source_read", video, text) for text in (*clip["warnings"], *([none] if none else [])))
            for stage, texts in (("frame_decode", _of_frames(clip, outputs.of("frame_decode", f"{video}/{name}"))),
                                 ("hand_detect", _of_hands(clip, outputs.part("hand_detect", f"{video}/{name}", "clip"))),
                                 ("hand_motion", _of_motions(outputs.part("hand_motion", f"{video}/{name}", "remarks"))),
                                 ("narration_labelling", _of_labels(outputs.of("narration_labelling", f"{video}/{name}")))):
                yield from (StageWarning(stage, name, text) for text in texts)
    except LostError as error:
        yield StageWarning("source_read", video, f"its warnings cannot be read ({error}); run again")


def _of_frames(clip: Fields, frames: Fields | None) -> Iterator[str]:
    if frames is None:
        return
    ((_, (*_, shape)),) = frames["rgb"].items()
    count, height_px, width_px = shape[:3]
    wanted = clip["last_frame"] - clip["first_frame"] + 1 if clip["media_kind"] == "video" else len(clip["media"])
    if count < wanted:
        yield f"{wanted - count} of {wanted} frames could not be decoded"
    remark = aspect_remark([(key["width_px"], key["height_px"]) for key in map(_plain, clip["key_frames"])], (width_px, height_px))
    if remark:
        yield remark


def _of_hands(read: Fields, clip: Fields | None) -> Iterator[str]:
    """Warn about a video without masks: warnings of the detection, and no hand or no contact at all.

    read: the clip before the detection.
    """
    if clip is None:
        return
    yield from clip["warnings"][len(read["warnings"]) :]
    hands = [mask for key in map(_plain, clip["key_frames"]) for mask in map(_plain, key["annotations"]) if mask["side"]]
    if not hands:
        yield "no hand was found"
    elif all(hand["contact"] in (*NOT_IN_CONTACT, *UNKNOWN_CONTACT) for hand in hands):
        yield "hands were found, but nothing that they touch"


def _of_motions(remarks: Fields | None) -> Iterator[str]:
    yield from remarks["texts"] if remarks else ()


def _of_labels(labels: Fields | None) -> Iterator[str]:
    if labels and labels["unmatched"]:
        silent = labels["unmatched"]
        yield f"{len(silent)} narration(s) speak of frames that are not there: {', '.join(silent[:SHOWN])}"


def _plain(value: Any) -> Fields:
    return dict(value["fields"])


class _Outputs:
    """Stored outputs of the tasks of one run."""

    def __init__(self, runner: Runner, report: RunReport) -> None:
        self._runner = runner
        self._done = set(report.cpu_s)
        self._keys: dict[str, dict[str, str]] = {}

    def shards(self, stage: str) -> list[str]:
        return sorted(shard for name, shard in self._done if name == stage)

    def clips(self, video: str) -> list[tuple[str, str]]:
        """(clip, digest) of every clip of a video."""
        digest = self._digest("source_read", video)
        return self._runner.children(digest) or [] if digest else []

    def of(self, stage: str, shard: str) -> Fields | None:
        """Fields of the output of a stage for a clip; None if the run has none."""
        digest = self._digest(stage, shard) if (stage, shard) in self._done else None
        return self.fields(digest) if digest else None

    def part(self, stage: str, shard: str, name: str) -> Fields | None:
        """Fields of one part of the output of a stage for a clip; None if the run has none."""
        digest = self._digest(stage, shard) if (stage, shard) in self._done else None
        return self.fields(dict(self._runner.children(digest) or [])[name]) if digest else None

    def fields(self, digest: str) -> Fields:
        """Fields of a stored value; no array is read."""
        return _plain(json.loads(self._runner.file(digest, VALUE).read_text(encoding="ascii")))

    def _digest(self, stage: str, shard: str) -> str | None:
        if stage not in self._keys:
            self._keys[stage] = self._runner.traces.shards(stage)
        key = self._keys[stage].get(shard)
        return self._runner.traces.output(key) if key else None
