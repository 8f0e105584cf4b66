"""What AffordDex reports, and rows of ours that mean the same beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from afford.grasp.cells import PCT, Cell, number
from afford.grasp.published import ROWS, Published
from afford.grasp.recipes import NO_NEGATIVE, STUDENT, TEACHER

SAME: tuple[tuple[str, str, str], ...] = (
    (TEACHER, "state", "AffordDex"),
    ("paper_reward", "state", "AffordDex"),
    (STUDENT, "vision", "AffordDex"),
    ("neither", "ablation, state", "none"),
    (NO_NEGATIVE, "ablation, state", "HTI"),
    ("student_no_negative", "ablation, vision", "two of HTI, distillation, NAA"),
    ("student_no_negative", "ablation, vision", "another two of them"),
    ("lambda_half", "lambda_n", "-5"),
    (TEACHER, "lambda_n", "-10"),
    ("lambda_double", "lambda_n", "-20"),
)
"""row of ours, published table and row. Which two parts each row of the vision ablation has could not be told: the student without
negative terms stands beside both"""


def lines(found: Sequence[Cell]) -> list[str]:
    """Markdown: the published rows; before them, where there are such, ours and theirs in one line."""
    return [*_beside(found), *_published()]


def _beside(found: Sequence[Cell]) -> list[str]:
    rows = [_line(cell, theirs) for cell, theirs in pairs(found)]
    head = ["## Beside the published", "", "Rows that mean the same, not the same test: objects and physics are others; HLS there",
            "is by a vision-language model, so that the two do not compare. AS of ours over successes.", "",
            "| table | theirs | ours | level | engine | Succ, theirs | ours | HLS, theirs | ours | AS, theirs | ours | seeds |",
            "|---|---|---|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    return [*head, *rows, ""] if rows else []


def pairs(found: Sequence[Cell]) -> Iterator[tuple[Cell, Published]]:
    """What both have, in the order of SAME: a cell with episodes and the published row of its level."""
    for ours, table, row in SAME:
        for theirs in ROWS:
            if (theirs.table, theirs.row) == (table, row):
                yield from ((cell, theirs) for cell in found
                            if (cell.policy, cell.level) == (ours, theirs.level) and cell.runs)  # fmt: skip


def _line(cell: Cell, theirs: Published) -> str:
    ours = PCT * cell.mean("success"), cell.mean("hls"), cell.mean("as_violation_pct", successes=True)
    both = zip((theirs.succ, theirs.hls, theirs.as_pct), ours, strict=True)
    values = " | ".join(f"{given:g} | {number(own, 1)}" for given, own in both)
    return f"| {theirs.table} | {theirs.row} | {cell.policy} | {cell.level} | {cell.engine} | {values} | {len(cell.runs)} |"


def _published() -> list[str]:
    out = ["## Published", "", "AffordDex, on its objects in Isaac Gym; HLS there by a vision-language model.", "",
           "| table | row | level | Succ | HLS | AS |", "|---|---|---|--:|--:|--:|"]  # fmt: skip
    return out + [f"| {r.table} | {r.row} | {r.level} | {r.succ:g} | {r.hls:g} | {r.as_pct:g} |" for r in ROWS]
