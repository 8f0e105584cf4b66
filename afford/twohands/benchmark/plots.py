"""Methods side by side, and whether their probabilities mean what they say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from afford.common.figures import Figure
from afford.twohands.benchmark.cases import KITCHEN
from afford.twohands.benchmark.summary import Row
from schemas.benchmark import MethodScores

SHOWN = ("iou", "precision", "hand_iou")


def bars(rows: Sequence[Row], path: Path) -> None:
    """IoU, precision and IoU per hand of every method, with 95 % intervals; kitchens of the cropped set where there are any."""
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


def reliability(scores: Sequence[MethodScores], path: Path) -> None:
    """Share that is true over predicted probability, for methods that give probabilities; nothing is written when none does."""
    told = [(one.name, one.reliability.sum(axis=0)) for one in scores if one.reliability[:, 0].any()]
    if not told:
        return
    figure = Figure(figsize=(5, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.plot((0, 1), (0, 1), color="#999999", lw=0.8)
    for name, (count, probability, truth) in told:
        some = count > 0
        axes.plot(probability[some] / count[some], truth[some] / count[some], marker="o", ms=3, lw=1, label=name)
    axes.set(xlabel="predicted probability of a pixel", ylabel="share of the valid ways that hold it", xlim=(0, 1), ylim=(0, 1))
    axes.legend(fontsize=7)
    figure.savefig(path, dpi=90, metadata={"Software": None})
