"""A few pictures to begin with: stills of a benchmark set that the project rendered itself, where one lies in the store."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2

from afford.benchmark.layout import ANNOTATION, IMAGE
from afford.predict.picture import read_image
from afford.recording.pictures import jpeg

COUNT = 6
MIN_SIDE_PX, MAX_SIDE_PX = 160, 640


@dataclass(frozen=True)
class Example:
    """A picture and a task that fits it."""

    task: str
    jpeg: bytes


def examples(benchmarks: Path) -> list[Example]:
    """Up to COUNT stills of the rendered sets below `benchmarks`, each of another room as far as there are so many; none when
    there is no set."""
    rooms = [sorted(room.glob(f"*/{IMAGE}")) for room in sorted(benchmarks.glob("*/masks/[!.]*"))]
    rooms = [room for room in rooms if room]
    turns = [room[n] for n in range(COUNT) for room in rooms if n < len(room)]
    found: list[Example] = []
    for path in turns:
        made = _example(path)
        if made and made.task not in {one.task for one in found}:
            found.append(made)
        if len(found) == COUNT:
            break
    return found


def _example(path: Path) -> Example | None:
    """The still without the black bars of its layout; None for a task without words and for a sliver."""
    task = str(json.loads((path.parent / ANNOTATION).read_text(encoding="utf-8")).get("narration") or "")
    rgb = read_image(path)
    seen = rgb.max(axis=(1, 2)).nonzero()[0]
    if not task or not len(seen):
        return None
    rgb = rgb[seen[0] : seen[-1] + 1]
    if min(rgb.shape[:2]) < MIN_SIDE_PX:
        return None
    scale = min(1.0, MAX_SIDE_PX / max(rgb.shape[:2]))
    return Example(task, jpeg(cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)))
