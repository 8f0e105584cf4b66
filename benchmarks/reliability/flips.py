"""1c: one damaged file in a store, of every kind. See tests/runner/test_store_damage.py, which states the same law."""

from __future__ import annotations

import random
from collections.abc import Iterator

from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import DAMAGES, FORMER, KINDS, STORED, built, healed, settled


def rows(plan: Plan) -> list[Row]:
    """One bit flipped, the modification time kept; then everything else that can happen to a file."""
    flips = [_row(plan, f"one bit flipped, mtime kept: {kind}{message}", kind, ["flip"] * plan.times(20, 2), cache, first)
             for kind in KINDS for message, cache, first in _ways(kind)]
    for kind in FORMER:
        row = Row(f"one bit flipped in a {kind} of former code that nothing uses any more: verify is content after the next run")
        for n in range(plan.times(20, 2)):
            project = built(plan.place(f"former {kind} {n}"), kind)
            row.count(settled(project, kind, "flip", random.Random(f"{plan.seed} former {kind} {n}")))
        flips.append(row)
    others = [how for how in DAMAGES if how != "flip"] * plan.times(3, 1)
    return flips + [_row(plan, f"file cut, removed or replaced by JSON that does not fit: {kind}", kind, others, True, False)
                    for kind in KINDS]  # fmt: skip


def _ways(kind: str) -> Iterator[tuple[str, bool, bool]]:
    """Return (description, .cache kept, verify before the run)."""
    yield ", .cache present" if kind in STORED else "", True, False
    if kind in STORED:
        yield ", .cache gone", False, False
    yield ", verify before the run", True, True


def _row(plan: Plan, what: str, kind: str, hows: list[str], cache: bool, first: bool) -> Row:
    row = Row(what)
    for n, how in enumerate(hows):
        project = built(plan.place(f"{what.replace('/', '-')} {n}"), kind)
        row.count(healed(project, kind, how, random.Random(f"{plan.seed} {what} {n}"), cache=cache, verify_first=first))
    return row
