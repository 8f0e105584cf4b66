"""Store of the figures of SOR3D-AFF's ablation trainings: separate runs are merged into one table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from afford.rgbd.evaluate import report
from afford.rgbd.evaluate.ablation_rows import ALL, recipes
from afford.rgbd.evaluate.report import figures_by_row, planned_seeds
from benchmarks.pages import ROOT

KEPT = ROOT / "benchmarks" / "sor3d_ablation.json"

Kept = dict[str, dict[str, Any]]
"""row-seed -> the commit that it was trained at, and its figures"""


def add(kept: Path, scores: Path, commit: str) -> Kept:
    """Add the figures of a report's scores.json to the stored ones; figures of the same training are replaced."""
    known: Kept = json.loads(kept.read_text()) if kept.exists() else {}
    known |= {name: {"commit": commit, "figures": figures} for name, figures in json.loads(scores.read_text()).items()}
    kept.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    return known


def table(known: Kept, motion: Mapping[str, float]) -> str:
    """Return every row over the seeds it has, with the commits of its trainings, and the scene flow rows, which have no seeds."""
    planned = recipes(ALL, range(1 + max(int(name.rpartition("-")[2]) for name in known)))
    done = {name: one["figures"] for name, one in known.items()}
    text = report.ablation_page(figures_by_row(planned, done), planned_seeds(planned)) + report.flow_page(motion)
    commits = ", ".join(dict.fromkeys(known[recipe.name]["commit"] for recipe in planned if recipe.name in known))
    return f"Trained at the commits {commits}.\n\n{text.partition(chr(10) * 2)[2]}"
