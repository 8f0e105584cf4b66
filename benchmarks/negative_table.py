"""Write the tables of docs/negative-affordance.md: categories with their parts, and what is true of every evaluated task.

    PYTHONPATH=. python benchmarks/negative_table.py

Nothing in those tables is typed by hand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from afford.backends.describe.lexicon import TASKS, rule
from afford.objects.build import BUILDERS
from afford.objects.split import UNSEEN

PAGE = Path(__file__).resolve().parent.parent / "docs" / "negative-affordance.md"
MARK, END = "<!-- {}: written by benchmarks/negative_table.py -->", "<!-- end of {} -->"


def categories() -> str:
    """Every category with its parts, and whether training sees it."""
    lines = ("| category | parts | |\n|---|---|---|\n",)
    for name in sorted(BUILDERS):
        parts = dict.fromkeys(solid.part for solid in BUILDERS[name](np.random.default_rng(0)))
        lines += (f"| {name} | {', '.join(parts)} | {'**unseen**' if name in UNSEEN else 'trained'} |\n",)
    return "".join(lines)


def tasks() -> str:
    """Every evaluated task with the parts that are negative and those where the hand belongs."""
    lines = ("| thing | task | must not be touched | a hand belongs on | why |\n|---|---|---|---|---|\n",)
    for name in sorted(TASKS):
        for task in TASKS[name]:
            row = rule(name, task)
            lines += (f"| {name} | {task} | {_list(row.negative)} | {_list(row.positive)} | {row.reason} |\n",)
    return "".join(lines)


def _list(parts: tuple[str, ...]) -> str:
    return ", ".join(parts) or "nothing"


def into(page: str, name: str, block: str) -> str:
    """The page with another block between the two marks; SystemExit where they are missing."""
    start, end = MARK.format(name), END.format(name)
    before, found, rest = page.partition(start)
    if not found or end not in rest:
        raise SystemExit(f"docs/negative-affordance.md: expected the marks of the part {name}")
    return f"{before}{start}\n{block}{end}{rest.partition(end)[2]}"


def main() -> None:
    """Replace both tables."""
    PAGE.write_text(into(into(PAGE.read_text(), "categories", categories()), "tasks", tasks()))


if __name__ == "__main__":
    main()
