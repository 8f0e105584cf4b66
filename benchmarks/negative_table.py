"""Write the tables of docs/surface/negative-affordance.md: categories with their parts, and the true parts of every task.

    PYTHONPATH=. python benchmarks/negative_table.py

Both tables are generated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from afford.surface.describe.lexicon import TASKS, rule
from afford.synthetic.objects.library import BUILDERS
from afford.synthetic.splits import UNSEEN_CATEGORIES
from benchmarks.pages import ROOT, into

PAGE = ROOT / "docs" / "surface" / "negative-affordance.md"


def categories() -> str:
    """Return each category with its parts, and whether training shows it."""
    lines = ("| category | parts | |\n|---|---|---|\n",)
    for name in sorted(BUILDERS):
        parts = dict.fromkeys(solid.part for solid in BUILDERS[name](np.random.default_rng(0)))
        lines += (f"| {name} | {', '.join(parts)} | {'**unseen**' if name in UNSEEN_CATEGORIES else 'trained'} |\n",)
    return "".join(lines)


def tasks() -> str:
    """Return each evaluated task with its negative parts and its natural parts."""
    lines = ("| thing | task | must not be touched | a hand belongs on | why |\n|---|---|---|---|---|\n",)
    for name in sorted(TASKS):
        for task in TASKS[name]:
            row = rule(name, task)
            lines += (f"| {name} | {task} | {_list(row.negative)} | {_list(row.positive)} | {row.reason} |\n",)
    return "".join(lines)


def _list(parts: tuple[str, ...]) -> str:
    return ", ".join(parts) or "nothing"


def main() -> None:
    """Replace both tables."""
    into(PAGE, "categories", Path(__file__).name, categories())
    into(PAGE, "tasks", Path(__file__).name, tasks())


if __name__ == "__main__":
    main()
