"""What a data set holds, in a few lines at the end of the run that made it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path


def content(dataset: Path) -> Iterator[str]:
    """Samples by split and by hands, and the frames that gave none, by reason: out of the statistics of a published data set."""
    found = json.loads((dataset / "statistics.json").read_text(encoding="utf-8"))
    samples, out = found["totals"]["samples"]["here"], found["frames_without_sample"]
    yield f"{samples:,} samples of {found['videos']} video(s): {_counts(found['splits'])}"
    yield f"hands: {_counts(found['taxonomy'])}"
    yield f"frames left out: {_counts(out)}" if out else "no frame left out"


def _counts(counts: Mapping[str, int]) -> str:
    """The largest first."""
    shown = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in shown if count)
