"""Rows of numbers as Markdown and LaTeX, the published ones beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from afford.twohands.benchmark.cases import KITCHEN, SHIFT
from afford.twohands.benchmark.summary import Row
from schemas.affordance import TAXONOMY

STRICT = (
    ("IoU", "iou"), ("precision", "precision"), ("recall", "recall"), ("F1", "f1"), ("HD px", "hd_px"), ("mAP", "map"),
    ("IoU per hand", "hand_iou"), ("best-mode IoU", "best_mode_iou"), ("taxonomy", "taxonomy_accuracy"),
    ("taxonomy, open", "taxonomy_open_accuracy"), ("hands", "hands_accuracy"), ("idle hand", "spurious"), ("ECE", "ece"),
)  # fmt: skip
COMPAT = (("IoU", "iou"), ("precision", "precision"), ("HD px", "hd_px"), ("mAP", "map"), ("counted", "counted"))
BOUNDED = ("IoU", "precision", "mAP")
"""columns with their interval"""
TITLES = {KITCHEN: "Kitchens", SHIFT: "Other scenes", "all": "All cases", "epic": "EPIC-KITCHENS", "ego4d": "Ego4D"}
SETS = {"cropped": "cropped to the objects", "masks": "whole images"}


class Published(NamedTuple):
    """A row of a paper, on ActAffordance, by its own script."""

    method: str
    paper: str
    values: dict[str, float]


PUBLISHED = (Published("AffExtract", "2HandedAfforder", {"precision": 0.420, "iou": 0.185}),)
"""numbers we have seen; others are in the paper"""


def markdown(rows: Sequence[Row], protocol: str, group: str, heading: str) -> str:
    """Strict and released measures of every method on one group."""
    mine = [row for row in rows if (row.protocol, row.group) == (protocol, group)]
    if not mine:
        return ""
    title = f"## {heading}: {TITLES.get(group, group)}, {SETS[protocol]}, {mine[0].cases} cases\n\n"
    columns = [(name, key) for name, key in STRICT if any(key in row.mean for row in mine)]
    strict = _table(["method", *(name for name, _ in columns)], [[row.method, *(_cell(row, *c) for c in columns)] for row in mine])
    return title + strict + "\nBy the definitions of the released script:\n\n" + _released(mine)


def _released(rows: Sequence[Row]) -> str:
    lines = [[row.method, *(_number(row.compat._asdict()[key], key) if row.compat else "-" for _, key in COMPAT)] for row in rows]
    lines += [[f"{row.method} ({row.paper}, ActAffordance)", *(_number(row.values.get(key), key) for _, key in COMPAT)]
              for row in PUBLISHED]  # fmt: skip
    return _table(["method", *(name for name, _ in COMPAT)], lines)


def confusion(method: str, counts: np.ndarray) -> str:
    """A Markdown table of true classes by predicted ones."""
    lines = [[f"**{TAXONOMY[n]}**", *map(str, line)] for n, line in enumerate(counts.tolist())]
    return f"### Taxonomy, {method}: true by row, predicted by column\n\n" + _table(["", *TAXONOMY], lines)


def notes(listed: Sequence[tuple[str, ...]]) -> str:
    """How many cases are odd, by kind."""
    kinds = [note.partition(":")[0].partition(" from ")[0] for of in listed for note in of]
    if not kinds:
        return ""
    lines = [[kind, str(kinds.count(kind))] for kind in sorted(set(kinds))]
    return "\n## What is odd about the cases\n\n" + _table(["note", "times"], lines)


def latex(rows: Sequence[Row], protocol: str, group: str) -> str:
    """A `tabular` of the strict measures, with \\toprule and friends of booktabs."""
    mine = [row for row in rows if (row.protocol, row.group) == (protocol, group)]
    columns = [(name, key) for name, key in STRICT if any(key in row.mean for row in mine)]
    lines = [" & ".join([_escape(row.method), *(_number(row.mean.get(key), key) for _, key in columns)]) for row in mine]
    head = " & ".join(["method", *(_escape(name) for name, _ in columns)])
    body = " \\\\\n".join(lines)
    return (f"% {group}, {protocol}\n\\begin{{tabular}}{{l{'r' * len(columns)}}}\n\\toprule\n{head} \\\\\n\\midrule\n{body} \\\\\n"
            "\\bottomrule\n\\end{tabular}\n")


def _cell(row: Row, name: str, key: str) -> str:
    text = _number(row.mean.get(key), key)
    return f"{text} [{_number(row.low[key], key)}, {_number(row.high[key], key)}]" if name in BOUNDED and key in row.low else text


def _number(value: float | None, key: str) -> str:
    if value is None:
        return "-"
    return f"{value:.1f}" if key.endswith("_px") else f"{value:.0f}" if key == "counted" else f"{value:.3f}"


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = "|" + "---|" * len(head) + "\n"
    return _line(head) + rule + "".join(map(_line, lines))


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |\n"


def _escape(text: str) -> str:
    return text.replace("_", "\\_").replace("%", "\\%").replace("&", "\\&")
