"""Train and examine hands that grasp, and write how they do where people read it.

    PYTHONPATH=. python benchmarks/bench_grasp.py [--store DIR] [--full]

Writes the results block of docs/grasping.md (with --full that of all rows), the table of the README and docs/pictures/grasps.png and
grasp_curves.png. Nothing in those is typed by hand.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from benchmarks.pages import ROOT, into, make

SHOWN = ("teacher", "no_negative", "prior", "student")
"""policies in the table of the README"""


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--full", action="store_true")
    asked = parser.parse_args()
    target = "grasp_full" if asked.full else "grasp"
    found = make(target, asked.store)
    report = Path(found["outputs"]["report"])
    text = (report / "report.md").read_text().partition("\n\n")[2]
    took = f"`make grasp` took {found['seconds'] / 60:.1f} minutes on this machine, all trainings included.\n\n"
    head = took if not asked.full and found["ran"].get("hand_imitation") and found["ran"].get("teacher_0") else ""
    into(ROOT / "docs" / "grasping.md", target, Path(__file__).name, head + text)
    if not asked.full:
        into(ROOT / "README.md", "grasp", Path(__file__).name, short(found["metrics"]))
        shutil.copyfile(report / "curves.png", ROOT / "docs" / "pictures" / "grasp_curves.png")
        sheet = next(Path(found["outputs"]["films"]).glob("*.png"))
        shutil.copyfile(sheet, ROOT / "docs" / "pictures" / "grasps.png")


def short(metrics: dict[str, float]) -> str:
    """A row for each policy and level in PyBullet."""
    rows = ["| policy | objects | Succ % | AS %, successes | HLS | contact with what is forbidden, end |", "|---|---|--:|--:|--:|--:|"]
    for policy in SHOWN:
        for level in ("train", "unseen_object", "unseen_size", "unseen_category"):
            if f"{policy}.succ.{level}" in metrics:
                value = {name: metrics.get(f"{policy}.{name}.{level}", float("nan"))
                         for name in ("succ", "as_violation_pct", "hls", "negative_contact_end")}  # fmt: skip
                rows.append(f"| {policy.replace('_', ' ')} | {level.replace('_', ' ')} | {100 * value['succ']:.1f} | "
                            f"{value['as_violation_pct']:.1f} | {value['hls']:.1f} | {value['negative_contact_end']:.2f} |")  # fmt: skip
    return "\n".join([*rows, ""])


if __name__ == "__main__":
    main()
