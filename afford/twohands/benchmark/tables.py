"""Mean scores by protocol, group and method, and their tables in Markdown and LaTeX.

Names of metrics: ``[compat.][masks.][<group>.]<method>.<measure>[.low|.high]``. The default protocol is cropped, and the
default group is kitchens; other groups are shift, all, epic, ego4d and those that a benchmark adds. `low` and `high` are the ends
of 95 % intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from afford.common import statistics
from afford.dataset.act_affordance import PROTOCOLS
from afford.twohands.benchmark import compat, measures
from afford.twohands.benchmark.cases import KITCHEN, SHIFT
from schemas.affordance import TAXONOMY
from schemas.benchmark import MethodScores

FIRST = (KITCHEN, SHIFT, "all", "epic", "ego4d")
"""first groups of the tables; others follow by name"""


class Row(NamedTuple):
    """Means of one method over one group of cases of one protocol."""

    method: str
    protocol: str
    group: str
    cases: int
    mean: dict[str, float]
    """measures that apply to a case of the group"""
    low: dict[str, float]
    high: dict[str, float]
    compat: compat.Summary | None

    @property
    def prefix(self) -> str:
        """Prefix of the names of its metrics."""
        group = "" if self.group == KITCHEN else f"{self.group}."
        return f"{'' if self.protocol == 'cropped' else 'masks.'}{group}{self.method}"


def groups(scores: Iterable[MethodScores]) -> list[str]:
    """List the groups of all cases, in the order of the tables."""
    seen = {group for one in scores for case in one.groups for group in case}
    return [name for name in FIRST if name in seen] + sorted(seen - set(FIRST))


def rows(scores: tuple[MethodScores, ...], resamples: int, seed: int) -> list[Row]:
    """Compute the rows of all protocols, groups and methods that have cases."""
    places = [(protocol, group) for protocol in PROTOCOLS for group in groups(scores)]
    found = (row(one, protocol, group, resamples, seed) for protocol, group in places for one in scores)
    return [one for one in found if one is not None]


def row(one: MethodScores, protocol: str, group: str, resamples: int, seed: int) -> Row | None:
    """Compute the means of a method over a group; None for a group without cases."""
    chosen = members(one, protocol, group)
    if not chosen.any():
        return None
    values = one.values[chosen]
    low, high = statistics.bootstrap_interval(values, resamples, seed)
    known = [n for n in range(len(one.measure)) if np.isfinite(values[:, n]).any()]
    mean = {one.measure[n]: float(np.nanmean(values[:, n])) for n in known} | _errors(one, chosen)
    ends = [{one.measure[n]: float(end[n]) for n in known} for end in (low, high)]
    return Row(one.name, protocol, group, int(chosen.sum()), mean, ends[0], ends[1], compat.summary(one.compat[chosen], one.level))


def members(one: MethodScores, protocol: str, group: str) -> np.ndarray:
    """Cases (n,) bool of a group of a protocol."""
    return np.array([own == protocol and group in groups_ for own, groups_ in zip(one.protocol, one.groups, strict=True)], bool)


def _errors(one: MethodScores, chosen: np.ndarray) -> dict[str, float]:
    """Calibration errors of pixels and of the taxonomy, for a method with probabilities."""
    out = {"ece": measures.expected_error(one.reliability[chosen].sum(axis=0))}
    right, sure = (one.values[chosen, one.measure.index(name)] for name in ("taxonomy_accuracy", "taxonomy_confidence"))
    known = np.isfinite(right)
    sums = np.stack([np.ones(known.sum()), sure[known], right[known]])
    out["taxonomy_ece"] = measures.expected_error(measures.binned(sure[known], sums))
    return {name: value for name, value in out.items() if np.isfinite(value)}


def metrics(found: Iterable[Row]) -> dict[str, float]:
    """Flatten rows into a dict of metrics."""
    flat = {name: value for one in found for name, value in _flat(one)}
    return dict(sorted(flat.items()))


def _flat(one: Row) -> Iterator[tuple[str, float]]:
    yield f"{one.prefix}.cases", float(one.cases)
    for end, values in (("", one.mean), (".low", one.low), (".high", one.high)):
        yield from ((f"{one.prefix}.{name}{end}", value) for name, value in values.items())
    if one.compat is not None:
        yield from ((f"compat.{one.prefix}.{name}", float(value)) for name, value in one.compat._asdict().items())


def confusion(one: MethodScores, chosen: np.ndarray) -> np.ndarray | None:
    """Confusion matrix (4, 4) of cases, true class by row; None for a method without a taxonomy."""
    known = chosen & (one.taxonomy_true >= 0) & (one.taxonomy_found >= 0)
    if not known.any():
        return None
    size = len(TAXONOMY)
    flat = one.taxonomy_true[known].astype(np.int64) * size + one.taxonomy_found[known]
    return np.bincount(flat, minlength=size * size).reshape(size, size)


STRICT = (
    ("first-mode IoU", "first_mode_iou"), ("best-mode IoU", "iou"), ("precision", "precision"), ("recall", "recall"),
    ("F1", "f1"), ("HD px", "hd_px"), ("mAP", "map"), ("IoU per hand", "hand_iou"), ("IoU over modes", "best_mode_iou"),
    ("taxonomy", "taxonomy_accuracy"),
    ("taxonomy, open", "taxonomy_open_accuracy"), ("hands", "hands_accuracy"), ("idle hand", "spurious"), ("ECE", "ece"),
)  # fmt: skip
COMPAT = (("IoU", "iou"), ("precision", "precision"), ("HD px", "hd_px"), ("mAP", "map"), ("counted", "counted"))
BOUNDED = ("first-mode IoU", "best-mode IoU", "precision", "mAP")
"""columns that show their interval"""
TITLES = {KITCHEN: "Kitchens", SHIFT: "Other scenes", "all": "All cases", "epic": "EPIC-KITCHENS", "ego4d": "Ego4D"}
SETS = {"cropped": "cropped to the objects", "masks": "whole images"}


RELEASED = ("\nBy the definitions of the released script. Rows of a paper are scores on ActAffordance: they compare with others "
            "only where the cases are the same.\n\n")  # fmt: skip


class Published(NamedTuple):
    """Scores in a paper, on ActAffordance, by its own script."""

    method: str
    paper: str
    values: dict[str, float]


PUBLISHED = (Published("AffExtract", "2HandedAfforder", {"precision": 0.420, "iou": 0.185}),)
"""published scores; the paper has more"""


def markdown(rows: Sequence[Row], protocol: str, group: str, heading: str) -> str:
    """Write the table of one group: strict measures of all methods, then those of the released script."""
    mine = [row for row in rows if (row.protocol, row.group) == (protocol, group)]
    if not mine:
        return ""
    title = f"## {heading}: {TITLES.get(group, group)}, {SETS[protocol]}, {mine[0].cases} cases\n\n"
    columns = [(name, key) for name, key in STRICT if any(key in row.mean for row in mine)]
    strict = _table(["method", *(name for name, _ in columns)], [[row.method, *(_cell(row, *c) for c in columns)] for row in mine])
    return title + strict + RELEASED + _released(mine)


def _released(rows: Sequence[Row]) -> str:
    lines = [[row.method, *(_number(row.compat._asdict()[key], key) if row.compat else "-" for _, key in COMPAT)] for row in rows]
    lines += [[f"{row.method} ({row.paper}, ActAffordance)", *(_number(row.values.get(key), key) for _, key in COMPAT)]
              for row in PUBLISHED]  # fmt: skip
    return _table(["method", *(name for name, _ in COMPAT)], lines)


def confusion_table(method: str, counts: np.ndarray) -> str:
    """Write a confusion matrix as a Markdown table."""
    lines = [[f"**{TAXONOMY[n]}**", *map(str, line)] for n, line in enumerate(counts.tolist())]
    return f"### Taxonomy, {method}: true by row, predicted by column\n\n" + _table(["", *TAXONOMY], lines)


def notes(listed: Sequence[tuple[str, ...]]) -> str:
    """Write the table of irregular cases, counted by kind."""
    kinds = [note.partition(":")[0].partition(" from ")[0] for of in listed for note in of]
    if not kinds:
        return ""
    lines = [[kind, str(kinds.count(kind))] for kind in sorted(set(kinds))]
    return "\n## What is odd about the cases\n\n" + _table(["note", "times"], lines)


def latex(rows: Sequence[Row], protocol: str, group: str) -> str:
    """Write the strict measures as a LaTeX `tabular` with the rules of booktabs."""
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
