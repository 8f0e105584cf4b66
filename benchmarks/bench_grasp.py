"""Train and examine hands that grasp, and write how they do where people read it.

    PYTHONPATH=. python benchmarks/bench_grasp.py [--store DIR] [--full [--policies NAMES] [--sections NAMES]]
        [--minutes N] [--set STAGE.PARAM=VALUE ...]

Writes the results block of docs/grasping/grasping.md, docs/pictures/grasps.png, two_tasks.png, grasp_curves.png; with --full the
block of all rows and the table of the README, of all policies that benchmarks/grasp_rows.json knows, to which those of this run, or
those of them that are named, are added. So seeds and rows can be trained a few at a time, and on other machines: `--set
grasp_report.seeds=1 --set rl_grasp_refinement.seed=2 --set grasp_student.seed=2` is the third seed. Sections that stand apart are
renewed when they are named: followed (how near the prior comes to clips) and full (what it is worth) in docs/grasping/imitation.md,
told (N_t as predicted), uses (use by use) and pairs (one object, two tasks) in docs/grasping/grasping.md. Nothing in those is
typed by hand.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from afford.grasping.evaluate.recipes import CARRIED, NO_NEGATIVE, STUDENT, TEACHER
from afford.grasping.evaluate.result_cells import MAIN, PCT, ResultRow
from afford.training.ablation import seeds_cell
from benchmarks import grasp_kept
from benchmarks.pages import ROOT, head, into, make, took

SELF = Path(__file__).name
SHOWN = (TEACHER, CARRIED, NO_NEGATIVE, "prior", STUDENT)
"""policies in the table of the README"""
SECTIONS = {"followed": ("grasping/imitation.md", "Clips that training never shows"),
            "full": ("grasping/imitation.md", "With and without the prior"),
            "told": ("grasping/grasping.md", "N_t as predicted"), "uses": ("grasping/grasping.md", "Use by use"),
            "pairs": ("grasping/grasping.md", "One object, two tasks")}  # fmt: skip
"""blocks, their pages, and where the report has them"""
FIGURES = ("succ", "as_violation_pct", "hls", "negative_contact_end")


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--policies", default="", help="with --full: those to add to the table; all")
    parser.add_argument("--sections", default="", help=f"with --full: of {','.join(SECTIONS)}, those to renew")
    parser.add_argument("--set", action="append", default=[], help="for fewer rows or seeds")
    parser.add_argument("--minutes", help="with --full: rows that are not finished by then are marked so")
    asked = parser.parse_args()
    wanted, policies = ([name for name in names.split(",") if name] for names in (asked.sections, asked.policies))
    if strange := sorted(set(wanted) - set(SECTIONS)):
        parser.error(f"--sections: expected some of {','.join(SECTIONS)}, got {','.join(strange)}")
    more = [*(("--minutes", asked.minutes) if asked.minutes else ()), *(word for one in asked.set for word in ("--set", one))]
    found = make("grasp-full" if asked.full else "grasp", asked.store, *more)
    report = Path(found["outputs"]["report"])
    settings = f"Asked for: `{' '.join(asked.set)}`.\n\n" if asked.set else ""
    text = (report / "report.md").read_text().partition("\n\n")[2].partition("\n## teacher")[0] + "\n"
    if asked.full:
        full(report, policies, {name: settings + section(text, SECTIONS[name][1]) for name in wanted})
    else:
        alone(report, settings + text, found)


def full(report: Path, policies: Sequence[str], sections: Mapping[str, str]) -> None:
    """The table with what this run adds to it, and sections of the run's report."""
    known = grasp_kept.add(grasp_kept.KEPT, report / "scores.json", head(), policies)
    into(ROOT / "docs" / "grasping" / "grasping.md", "grasp-full", SELF, grasp_kept.table(known))
    into(ROOT / "README.md", "grasp", SELF, short(grasp_kept.rows(known)))
    for name, text in sections.items():
        into(ROOT / "docs" / SECTIONS[name][0], name, SELF, text)


def alone(report: Path, text: str, found: Mapping[str, Any]) -> None:
    """Write the report of one seed, its run time if nothing was cached, and pictures."""
    page = (ROOT / "docs" / "grasping" / "grasping.md", "grasp", SELF)
    line = f"`make grasp` took {found['seconds'] / 60:.1f} minutes on this machine, all trainings included.\n\n"
    anew = found["ran"].get("hand_imitation") and found["ran"].get("teacher_0")
    into(*page, took(*page, line if anew else "") + text.replace("\n## ", "\n### "))
    for name, picture in (("curves", "grasp_curves"), ("two_tasks", "two_tasks")):
        shutil.copyfile(report / f"{name}.png", ROOT / "docs" / "pictures" / f"{picture}.png")
    sheet = next(Path(found["outputs"]["films"]).glob("*.png"))
    shutil.copyfile(sheet, ROOT / "docs" / "pictures" / "grasps.png")


def section(text: str, title: str) -> str:
    """Return the text below a heading of the report. Raises SystemExit when the heading is missing."""
    _, there, after = text.partition(f"## {title}\n\n")
    if not there:
        raise SystemExit(f"{title}: the report has no such section; ask for the rows that it is of")
    return after.partition("\n## ")[0].strip() + "\n"


def short(rows: Sequence[ResultRow]) -> str:
    """A line for each policy that is shown and level in PyBullet; those that are not finished marked so."""
    lines = ["| policy | objects | Succ % | AS %, successes | HLS | forbidden contact at end (rate) | seeds |",
             "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    for row in (row for policy in SHOWN for row in rows if (row.policy, row.engine) == (policy, MAIN)):
        succ, safe, hls, touch = (row.figures.get(name, float("nan")) for name in FIGURES)
        label = f"{row.policy.replace('_', ' ')} | {row.level.replace('_', ' ')}"
        seeds = seeds_cell(row.seeds, row.planned)
        lines.append(f"| {label} | {PCT * succ:.1f} | {safe:.1f} | {hls:.1f} | {touch:.2f} | {seeds} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
