"""1d: random files of a store are deleted. The next run ends right and the store is whole."""

from __future__ import annotations

import random
import shutil

from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import FlippedStore, NoEndError, apart, last_line

COUNTS = (1, 5, 40, 0)
"""files deleted at once; 0: a whole folder"""
FOLDERS = ("blobs", "traces", "code", ".cache", "leases", "scratch")


def rows(plan: Plan) -> list[Row]:
    """Rounds of each amount."""
    row = Row("1, 5 or 40 random files deleted, or a whole folder")
    for n in range(plan.times(28, 4)):
        project = FlippedStore(plan.place(f"lost-{n}"), ("ab", "cd", "ef", "gh", "ij")).write()
        apart(project.run)
        row.count(_wrong(project, COUNTS[n % len(COUNTS)], random.Random(f"{plan.seed} {n}")))
    return [row]


def _wrong(project: FlippedStore, count: int, rng: random.Random) -> list[str]:
    files = sorted(path for path in project.store.rglob("*") if path.is_file())
    gone = [project.store / rng.choice(FOLDERS)] if not count else rng.sample(files, count)
    for path in gone:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    message = f"{len(gone)} files deleted" if count else f"{gone[0].name}/ deleted"
    try:
        found = apart(project.run)
        wrong = [] if found["texts"] == project.expected() else [f"wrong outputs {found['failures'][:2]}"]
        wrong += [] if apart(project.verify) else ["verify after the run is not ok"]
    except (NoEndError, RuntimeError) as error:
        wrong = [last_line(error)]
    return [f"{message}: {what}" for what in wrong]
