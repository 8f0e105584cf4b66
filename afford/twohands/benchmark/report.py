"""Benchmark report: tables, plots and contact sheets of all methods, as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from afford.common import files
from afford.common.figures import Figure
from afford.dataset.act_affordance import PROTOCOLS
from afford.twohands.benchmark import tables
from afford.twohands.benchmark.cases import KITCHEN
from afford.twohands.benchmark.tables import Row
from schemas.benchmark import MethodScores
from schemas.files import FileTree

SHOWN = ("iou", "precision", "hand_iou")


def bar_plot(rows: Sequence[Row], path: Path) -> None:
    """Plot IoU, precision and IoU per hand of all methods with 95 % intervals, for the first group of the report."""
    first = rows[0]
    mine = [row for row in rows if (row.protocol, row.group) == (first.protocol, first.group)]
    figure = Figure(figsize=(9, 1.2 + 0.45 * len(mine)), layout="constrained")
    panels = figure.subplots(1, len(SHOWN), sharey=True)
    for panel, name in zip(panels, SHOWN, strict=True):
        mean = np.array([row.mean[name] for row in mine])
        gap = np.array([[row.mean[name] - row.low[name], row.high[name] - row.mean[name]] for row in mine]).T
        panel.barh(range(len(mine)), mean, xerr=np.maximum(gap, 0), color="#4c7fb5", ecolor="#333333")
        panel.set(title=name, xlim=(0, 1))
    panels[0].set_yticks(range(len(mine)), [row.method for row in mine], fontsize=8)
    panels[0].invert_yaxis()
    figure.suptitle(f"{'kitchens' if first.group == KITCHEN else first.group}, {first.protocol}", fontsize=10)
    figure.savefig(path, dpi=90, metadata={"Software": None})


def reliability_plot(scores: Sequence[MethodScores], path: Path) -> None:
    """Plot the true share over the predicted probability; no file is written when no method gives probabilities."""
    tables = [(one.name, one.reliability.sum(axis=0)) for one in scores if one.reliability[:, 0].any()]
    if not tables:
        return
    figure = Figure(figsize=(5, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.plot((0, 1), (0, 1), color="#999999", lw=0.8)
    for name, (count, probability, truth) in tables:
        some = count > 0
        axes.plot(probability[some] / count[some], truth[some] / count[some], marker="o", ms=3, lw=1, label=name)
    axes.set(xlabel="predicted probability of a pixel", ylabel="share of the valid ways that hold it", xlim=(0, 1), ylim=(0, 1))
    axes.legend(fontsize=7)
    figure.savefig(path, dpi=90, metadata={"Software": None})


DETAILS = ("iou", "precision", "recall", "hd_px", "map", "hand_iou", "best_mode_iou", "taxonomy_accuracy", "hands_accuracy")


def write(scores: tuple[MethodScores, ...], folder: Path, resamples: int, seed: int) -> FileTree:
    """Write report.md, tables.tex, metrics.json, cases.json, plots/ and sheets/.

    ValueError when methods share a name, or were scored on different cases.
    """
    check(scores)
    found = tables.rows(scores, resamples, seed)
    files.write_json(folder / "metrics.json", {"cases": len(scores[0].case_id)} | tables.metrics(found))
    files.write_json(folder / "cases.json", {one.name: per_case(one) for one in scores})
    (folder / "report.md").write_text(markdown(scores, found), encoding="utf-8")
    places = dict.fromkeys((row.protocol, row.group) for row in found)
    (folder / "tables.tex").write_text("\n".join(tables.latex(found, *place) for place in places), encoding="utf-8")
    (folder / "plots").mkdir()
    bar_plot(found, folder / "plots" / "scores.png")
    reliability_plot(scores, folder / "plots" / "reliability.png")
    (folder / "sheets").mkdir()
    for one in scores:
        for sheet in one.sheets:
            (folder / "sheets" / f"{one.name}_{sheet.protocol}.jpg").write_bytes(sheet.jpeg.tobytes())
    return files.tree("benchmark", folder)


def check(scores: Sequence[MethodScores]) -> None:
    """Raise ValueError unless the methods have different names and the same cases."""
    if not scores:
        raise ValueError("the report needs at least one method")
    names = [one.name for one in scores]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two methods are called {', '.join(twice)}; rename one of the folders of predictions")
    for one in scores:
        if one.case_id != scores[0].case_id:
            raise ValueError(f"{one.name}: expected scores of the {len(scores[0].case_id)} cases of {scores[0].name}, got others "
                             f"({len(one.case_id)}); score both on the same benchmark")


def markdown(scores: Sequence[MethodScores], found: Sequence[tables.Row]) -> str:
    """Write the report as Markdown."""
    parts = ["# Benchmark of two-hand affordances\n\nIntervals are 95 %, by resampling cases. What each column means: "
             "docs/twohands/benchmark.md.\n\n"]  # fmt: skip
    for protocol, group in dict.fromkeys((row.protocol, row.group) for row in found):
        parts.append(tables.markdown(found, protocol, group, "Methods") + "\n")
    for one in scores:
        for protocol in PROTOCOLS:
            counts = tables.confusion(one, tables.members(one, protocol, "all"))
            parts += [tables.confusion_table(f"{one.name}, {protocol}", counts) + "\n"] if counts is not None else []
    return "".join(parts) + tables.notes(scores[0].notes)


def per_case(one: MethodScores) -> dict[str, dict[str, float]]:
    """Main measures of each case to which they apply."""
    place = {name: one.measure.index(name) for name in DETAILS}
    cells = ({name: round(float(row[n]), 6) for name, n in place.items() if row[n] == row[n]} for row in one.values)
    return dict(zip(one.case_id, cells, strict=True))
