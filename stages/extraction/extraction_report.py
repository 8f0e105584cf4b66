"""Summarise the scores of many clips in the quality report: table, plots, contact sheet and a flat dict of metrics.

Reads   ClipScores of standard and hard clips
Writes  metrics.json, report.md, scores.png, sheet.jpg
Method  means over all items of the standard clips; means over the hard clips have the prefix `hard.`
Fails   without a standard clip
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.benchmark import ClipScores
from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "opencv-python-headless", "matplotlib", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `extraction_report`."""

    eval_seed: int = 20261
    """seed of the clips that are rendered for the report; the quality floors hold for any seed"""
    standard_clips: int = 8
    """number of standard clips"""
    hard_clips: int = 6
    """number of hard clips (never unoccluded, out of plane, articulated, entering or leaving between key frames)"""


def run(scores: tuple[ClipScores, ...], params: Params, ctx: Context) -> FileTree:
    """Merge the scores of all clips into one report."""
    from afford.extraction import quality_report

    return quality_report.write_report(scores, ctx.scratch)
