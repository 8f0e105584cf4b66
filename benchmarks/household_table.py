"""Write the tables and the picture of docs/grasping/household.md: the categories, and the report of a run of `grasp-household`.

    PYTHONPATH=. python benchmarks/household_table.py [--store DIR]      # after `run grasp-household --store DIR`

Refusals are counted, not listed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from afford.grasping.sim.walls import WALLS
from afford.surface.describe.household import PARTS_OF, uses_of
from afford.surface.describe.looks import PARTS
from afford.synthetic.objects.household_bodies import CATEGORIES, HELD_OUT, STANDING
from benchmarks.pages import ROOT, into, stack_sheets

PAGE = ROOT / "docs" / "grasping" / "household.md"
SCRIPT = "household_table.py"
SHOWN = ("handle", "pinch", "body", "rim", "hook")
"""families of the picture, from top to bottom"""


def categories() -> Iterator[str]:
    """Yield a row for each category."""
    yield from ("", "| category | built | wall | parts | uses |", "|---|---|---|---|---|")
    for name in sorted(CATEGORIES):
        wall = f"{1000 * WALLS[name].thick_m:g} mm {WALLS[name].of}" if name in WALLS else "solid, 700 kg/m3"
        parts = ", ".join((PARTS.get(name) or PARTS_OF[name]).split())
        yield (f"| {name.replace('_', ' ')}{', **held out**' if name in HELD_OUT else ''} | "
               f"{'standing' if name in STANDING else 'lying'} | {wall} | {parts} | {'; '.join(uses_of(name))} |")
    yield ""


def results(report: str) -> Iterator[str]:
    """Yield the tables of a report, without its introduction and refusals."""
    kept = report.partition("## All")[2].partition("## Refused")[0]
    lines = f"## All{kept}".strip().splitlines()
    yield from ("", *(f"**{line[3:]}**" if line.startswith("## ") else line for line in lines))
    refused = report.partition("## Refused")[2].count("\n- ")
    yield from ("", f"{refused} further uses in a pose were refused: no place for a hand.", "")


def main() -> None:
    """Write both blocks; the second one, and the picture, where the run has a report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--store", type=Path, default=ROOT / "artifacts")
    store = parser.parse_args().store
    report, films = store / "reports" / "grasp-household" / "report.md", store / "recordings" / "grasp-household"
    into(PAGE, "categories", SCRIPT, "\n".join(categories()))
    if report.exists():
        into(PAGE, "results", SCRIPT, "\n".join(results(report.read_text())))
        stack_sheets([sheet for one in SHOWN for sheet in films.glob(f"{one}-mujoco/*.png")], "household.jpg")


if __name__ == "__main__":
    main()
