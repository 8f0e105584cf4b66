"""What AffordDex reports, and rows of ours that mean the same beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from afford.grasping.evaluate.cells import PCT, number
from afford.grasping.evaluate.published import ROWS, Published
from afford.grasping.evaluate.recipes import NO_NEGATIVE, STUDENT, TEACHER
from afford.grasping.evaluate.report_rows import Row

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


def lines(found: Sequence[Row]) -> list[str]:
    """Markdown: the published rows; before them, where there are such, ours and theirs in one line."""
    return [*beside(found), *_published()]


def beside(found: Sequence[Row]) -> list[str]:
    """Those that mean the same; nothing where there is none."""
    rows = [_line(row, theirs) for row, theirs in pairs(found)]
    head = ["## Beside the published", "", "Rows that mean the same, not the same test: objects and physics are others; HLS there",
            "is by a vision-language model, so that the two do not compare. AS of ours over successes.", "",
            "| table | theirs | ours | level | engine | Succ, theirs | ours | HLS, theirs | ours | AS, theirs | ours | seeds |",
            "|---|---|---|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    return [*head, *rows, ""] if rows else []


def pairs(found: Sequence[Row]) -> Iterator[tuple[Row, Published]]:
    """What both have, in the order of SAME: a row with figures and the published row of its level."""
    for ours, table, row in SAME:
        for theirs in ROWS:
            if (theirs.table, theirs.row) == (table, row):
                yield from ((one, theirs) for one in found if (one.policy, one.level) == (ours, theirs.level) and one.figures)


def _line(row: Row, theirs: Published) -> str:
    ours = PCT * row.figures["succ"], *(row.figures.get(name, float("nan")) for name in ("hls", "as_violation_pct"))
    both = zip((theirs.succ, theirs.hls, theirs.as_pct), ours, strict=True)
    values = " | ".join(f"{given:g} | {number(own, 1)}" for given, own in both)
    return f"| {theirs.table} | {theirs.row} | {row.policy} | {row.level} | {row.engine} | {values} | {row.seeds} |"


def _published() -> list[str]:
    out = ["## Published", "", "AffordDex, on its objects in Isaac Gym; HLS there by a vision-language model.", "",
           "| table | row | level | Succ | HLS | AS |", "|---|---|---|--:|--:|--:|"]  # fmt: skip
    return out + [f"| {r.table} | {r.row} | {r.level} | {r.succ:g} | {r.hls:g} | {r.as_pct:g} |" for r in ROWS]
