"""Scores of all methods -> the report, as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from afford.common import files
from afford.dataset.act_affordance import PROTOCOLS
from afford.twohands.benchmark import plots, summary, tables
from schemas.benchmark import MethodScores
from schemas.files import FileTree

DETAILS = ("iou", "precision", "recall", "hd_px", "map", "hand_iou", "best_mode_iou", "taxonomy_accuracy", "hands_accuracy")


def write(scores: tuple[MethodScores, ...], folder: Path, resamples: int, seed: int) -> FileTree:
    """report.md, tables.tex, metrics.json, cases.json, plots/ and sheets/. ValueError when methods share a name, or were not
    scored on the same cases.
    """
    check(scores)
    found = summary.rows(scores, resamples, seed)
    files.write_json(folder / "metrics.json", {"cases": len(scores[0].case_id)} | summary.metrics(found))
    files.write_json(folder / "cases.json", {one.name: per_case(one) for one in scores})
    (folder / "report.md").write_text(markdown(scores, found), encoding="utf-8")
    places = dict.fromkeys((row.protocol, row.group) for row in found)
    (folder / "tables.tex").write_text("\n".join(tables.latex(found, *place) for place in places), encoding="utf-8")
    (folder / "plots").mkdir()
    plots.bars(found, folder / "plots" / "scores.png")
    plots.reliability(scores, folder / "plots" / "reliability.png")
    (folder / "sheets").mkdir()
    for one in scores:
        for sheet in one.sheets:
            (folder / "sheets" / f"{one.name}_{sheet.protocol}.jpg").write_bytes(sheet.jpeg.tobytes())
    return files.tree("benchmark", folder)


def check(scores: Sequence[MethodScores]) -> None:
    """ValueError when the methods cannot stand in one table."""
    if not scores:
        raise ValueError("the report needs at least one method, got none")
    names = [one.name for one in scores]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two methods are called {', '.join(twice)}; rename one of the folders of predictions")
    for one in scores:
        if one.case_id != scores[0].case_id:
            raise ValueError(f"{one.name}: expected scores of the {len(scores[0].case_id)} cases of {scores[0].name}, got others "
                             f"({len(one.case_id)}); score both on the same benchmark")


def markdown(scores: Sequence[MethodScores], found: Sequence[summary.Row]) -> str:
    """The whole report as text."""
    parts = ["# Benchmark of two-hand affordances\n\nIntervals are 95 %, by resampling cases. What each column means: "
             "docs/twohands/benchmark.md.\n\n"]  # fmt: skip
    for protocol, group in dict.fromkeys((row.protocol, row.group) for row in found):
        parts.append(tables.markdown(found, protocol, group, "Methods") + "\n")
    for one in scores:
        for protocol in PROTOCOLS:
            counts = summary.confusion(one, summary.members(one, protocol, "all"))
            parts += [tables.confusion(f"{one.name}, {protocol}", counts) + "\n"] if counts is not None else []
    return "".join(parts) + tables.notes(scores[0].notes)


def per_case(one: MethodScores) -> dict[str, dict[str, float]]:
    """The main measures of every case, where they apply."""
    place = {name: one.measure.index(name) for name in DETAILS}
    cells = ({name: round(float(row[n]), 6) for name, n in place.items() if row[n] == row[n]} for row in one.values)
    return dict(zip(one.case_id, cells, strict=True))
