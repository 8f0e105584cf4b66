"""Train and examine hands that grasp, and write how they do where people read it.

    PYTHONPATH=. python benchmarks/bench_grasp.py [--store DIR] [--full [--sections]] [--minutes N] [--set STAGE.PARAM=VALUE ...]

Writes the results block of docs/grasping.md, docs/pictures/grasps.png, two_tasks.png, grasp_curves.png; with --full the block of
all rows, the table of the README and, each where the run has it, how near the prior comes to clips and what it is worth
(docs/imitation.md) and what N_t as predicted is worth; with --sections these alone, so that a run of few rows writes them.
Nothing in those is typed by hand.
"""

from __future__ import annotations

import argparse
import shutil
from itertools import product
from pathlib import Path

from afford.training.ablation import done
from benchmarks.pages import ROOT, into, make, took
from schemas.grasp_task import LEVELS

SHOWN = ("teacher", "no_negative", "prior", "student")
"""policies in the table of the README"""
SECTIONS = {"followed": ("imitation.md", "Clips that training never shows"), "full": ("imitation.md", "With and without the prior"),
            "told": ("grasping.md", "N_t as predicted")}  # fmt: skip
"""blocks, their pages, and where the report has them; what a run was not asked for stays"""
FIGURES = ("succ", "as_violation_pct", "hls", "negative_contact_end")


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--sections", action="store_true", help="with --full: only the blocks that stand apart from the table")
    parser.add_argument("--set", action="append", default=[], help="for fewer rows or seeds; it is written beside the table")
    parser.add_argument("--minutes", help="with --full: rows that are not finished by then are marked so")
    asked = parser.parse_args()
    target = "grasp-full" if asked.full else "grasp"
    limit = ("--minutes", asked.minutes) if asked.minutes else ()
    found = make(target, asked.store, *limit, *(word for one in asked.set for word in ("--set", one)))
    report = Path(found["outputs"]["report"])
    settings = f"Asked for: `{' '.join(asked.set)}`.\n\n" if asked.set else ""
    text = (report / "report.md").read_text().partition("\n\n")[2].partition("\n## teacher")[0] + "\n"
    if asked.full:
        apart(text, settings)
        text = without(text, SECTIONS["told"][1])
    if asked.sections:
        return
    page = (ROOT / "docs" / "grasping.md", target, Path(__file__).name)
    line = f"`make grasp` took {found['seconds'] / 60:.1f} minutes on this machine, all trainings included.\n\n"
    anew = not asked.full and found["ran"].get("hand_imitation") and found["ran"].get("teacher_0")
    into(*page, took(*page, line if anew else "") + settings + text)
    if asked.full:
        into(ROOT / "README.md", "grasp", Path(__file__).name, short(found["metrics"]))
    else:
        shutil.copyfile(report / "curves.png", ROOT / "docs" / "pictures" / "grasp_curves.png")
        shutil.copyfile(report / "two_tasks.png", ROOT / "docs" / "pictures" / "two_tasks.png")
        sheet = next(Path(found["outputs"]["films"]).glob("*.png"))
        shutil.copyfile(sheet, ROOT / "docs" / "pictures" / "grasps.png")


def apart(text: str, settings: str) -> None:
    """The sections of the report that have blocks of their own."""
    for name, (page, title) in SECTIONS.items():
        told = section(text, title)
        if told.strip():
            into(ROOT / "docs" / page, name, Path(__file__).name, settings * (name == "full") + told)


def without(text: str, title: str) -> str:
    """A report less what stands under a heading, and the heading."""
    before, found, after = text.partition(f"## {title}\n\n")
    return before + after[after.find("## ") :] if found and "## " in after else before


def section(text: str, title: str) -> str:
    """What stands under a heading of the report."""
    return text.partition(f"## {title}\n\n")[2].partition("\n## ")[0].strip() + "\n"


def short(metrics: dict[str, float]) -> str:
    """A row for each policy and level in PyBullet, means over seeds; those that are not finished marked so."""
    rows = ["| policy | objects | Succ % | AS %, successes | HLS | touches what is forbidden, end | seeds |",
            "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    for policy, level in product(SHOWN, LEVELS):
        if f"{policy}.succ.{level}" in metrics:
            succ, safe, hls, touch = (metrics.get(f"{policy}.{name}.{level}", float("nan")) for name in FIGURES)
            label = f"{policy.replace('_', ' ')} | {level.replace('_', ' ')}"
            seeds, missing = (int(metrics[f"{policy}.{name}.{level}"]) for name in ("seeds", "unfinished"))
            rows.append(f"| {label} | {100 * succ:.1f} | {safe:.1f} | {hls:.1f} | {touch:.2f} | {done(seeds, seeds + missing)} |")
    return "\n".join([*rows, ""])


if __name__ == "__main__":
    main()
