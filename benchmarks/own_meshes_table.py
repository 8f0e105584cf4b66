"""Write a table of docs/grasping/own-meshes.md: the scans of a run of `grasp-adapt`, as it is and adapted, or of `grasp`.

    python pipeline.py run grasp-adapt --source ../shared/data/objects
    PYTHONPATH=. python benchmarks/own_meshes_table.py [--store DIR]
    python pipeline.py run grasp-adapt --source ../shared/data/motion/dexycb_meshes --set body_evaluate.episodes=10
    PYTHONPATH=. python benchmarks/own_meshes_table.py [--store DIR] --report dexycb_meshes-adapted --block "simplified scans"

The rows are those of the report of the run, and what its adaptation kept. A run of some scans (--clip) has a report of its own.
`--picture own_meshes.jpg` also writes the picture of the page, from the sheets of the run's films in PyBullet.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from benchmarks.pages import ROOT, into, stack_sheets

PAGE = ROOT / "docs" / "grasping" / "own-meshes.md"
SCRIPT = "own_meshes_table.py"
ENGINES = {"bullet": "PyBullet", "mujoco": "MuJoCo"}
POLICIES = {"teacher": "of flat tools", "bodies": "as it is", "tried": "at tried places", "adapted": "adapted"}
HEAD = "| object | policy | engine |"


def rows(report: str, title: str, width: int) -> Iterator[list[str]]:
    """Yield the cells of the table of a report that begins with the line `title`."""
    for line in report.partition(f"\n{title}")[2].splitlines()[2:]:
        if not line.startswith("|"):
            return
        cells = [cell.strip() for cell in line.strip("| \n").split("|")]
        yield cells + [""] * (width - len(cells))


def table(report: str) -> Iterator[str]:
    """Yield a row for each object: Succ, held and AS of the policies in both engines, and what an adaptation kept."""
    found = {(cells[0], cells[1], cells[2]): cells for cells in rows(report, HEAD, 11)}
    kept = {cells[0]: cells[-1].partition(":")[0] for cells in rows(report, "| object | Succ % as it was |", 6)}
    pairs = [(engine, policy) for engine in ENGINES for policy in POLICIES if any(key[1:] == (policy, engine) for key in found)]
    for figure, column in (("Succ %", 3), ("held %", 6), ("AS %, successes", 7)):
        head = " | ".join(f"{ENGINES[engine]}, {POLICIES[policy]}" for engine, policy in pairs)
        yield from ("", f"**{figure}**", "", f"| object | {head} |{' kept |' if kept else ''}",
                    f"|---|{'--:|' * len(pairs)}{'---|' if kept else ''}")  # fmt: skip
        for name in dict.fromkeys(key[0] for key in found):
            cells = [found[name, policy, engine][column] if (name, policy, engine) in found else "-" for engine, policy in pairs]
            yield f"| {name} | {' | '.join(cells)} |{f' {kept.get(name, str())} |' if kept else ''}"
    yield ""


def main() -> None:
    """Write the block."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--store", type=Path, default=ROOT / "artifacts")
    parser.add_argument("--report", default="objects-adapted")
    parser.add_argument("--block", default="scans", help="name of the block of the page")
    parser.add_argument("--picture", default="", help="name of a picture to write")
    given = parser.parse_args()
    report = given.store / "reports" / given.report / "report.md"
    into(PAGE, given.block, SCRIPT, "\n".join(table(report.read_text(encoding="utf-8"))))
    if given.picture:
        stack_sheets(sorted((given.store / "recordings" / given.report / "grasps-0").glob("*.png")), given.picture)


if __name__ == "__main__":
    main()
