"""Table of several models on the same single pictures, next to the paper's figures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from afford.common.files import write_json
from afford.rgbd.evaluate import ablation_rows
from schemas.files import FileTree

FIGURES = {"iou": "IoU", "f": "F", "fw": "weighted F", "closed.iou": "IoU, closed"}
WORDS = {"static_sor3d": "the model of sequences", "static_boxes": "detector, its own boxes",
         "static_true_boxes": "detector, true boxes"}  # fmt: skip
PAPER = {"its model": ablation_rows.PUBLISHED_MODEL["static"], "AffordanceNet": ablation_rows.PUBLISHED_AFFORDANCENET}


def read_figures(report: FileTree) -> dict[str, float]:
    """Read the table's figures from a report of static_evaluate. ValueError when it lacks one."""
    found = report.find("metrics.json")
    numbers = json.loads(found.path.read_text(encoding="utf-8")) if found else {}
    if missing := FIGURES.keys() - numbers.keys():
        raise ValueError(f"{report.name}: expected metrics.json with {', '.join(FIGURES)}, got no {', '.join(sorted(missing))}")
    return {name: numbers[name] for name in FIGURES}


def write(root: Path, name: str, found: Mapping[str, Mapping[str, float]]) -> Path:
    """Write metrics.json and report.md to `root`; `found` maps methods to their FIGURES."""
    write_json(root / "metrics.json", {f"{method}.{key}": value for method, one in found.items() for key, value in one.items()})
    (root / "report.md").write_text(f"# Affordances of single pictures: {name}\n\n{table(found)}", encoding="utf-8", newline="\n")
    return root


def table(found: Mapping[str, Mapping[str, float]]) -> str:
    """Markdown table with a line for each method and the paper's two models below, which are of its own data."""
    ours = [[WORDS.get(method, method), *(f"{one[key]:.3f}" for key in FIGURES)] for method, one in found.items()]
    paper = [[f"paper, its data: {words}", *(f"{value:.2f}" for value in values), ""] for words, values in PAPER.items()]
    head = f"| | {' | '.join(FIGURES.values())} |\n|---|{'--:|' * len(FIGURES)}\n"
    return head + "".join(f"| {' | '.join(cells)} |\n" for cells in (*ours, *paper))
