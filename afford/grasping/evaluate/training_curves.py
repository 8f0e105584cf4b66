"""Plot training curves: a panel for each curve, a colour for each run, a thin line for each seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from afford.common.figures import Figure
from afford.common.palette import LEFT, OBJECTS, RIGHT, web
from schemas.training import Curve, TrainingLog

COLOURS = tuple(web(colour) for colour in (RIGHT, LEFT, *OBJECTS))
TITLES = {"success": "success (share of episodes)", "as_violation_pct": "AS: unsafe fingertips (%)",
          "negative_contact_end": "negative contact at the end"}  # fmt: skip
"""last word of a curve -> title of its panel"""
REWARD = "reward"
"""part of the names of curves of reward terms"""
WIDE, TALL_IN, PANEL_IN = 3, 2.7, 3.8
SMOOTH, FINEST = 0.03, 200
"""window of smoothing as a share of the curve; most points of a mean over seeds"""


def write_curves(path: Path, runs: Mapping[str, Sequence[TrainingLog]], steps_per_update: int = 1,
                 names: Sequence[str] = ()) -> None:  # fmt: skip
    """Write a PNG of runs (label -> its seeds) against control steps, `steps_per_update` of them for each step of a log.

    Panels are the curves `names`, or those of TITLES and of rewards that any log has. ValueError when there are no such curves.
    """
    shown = list(names) or _shown(runs)
    if not shown:
        raise ValueError(f"runs: no curves of success, AS or rewards in {', '.join(runs) or 'any run'}")
    wide = min(WIDE, len(shown))
    tall = -(-len(shown) // wide)
    figure = Figure(figsize=(PANEL_IN * wide, TALL_IN * tall + 0.4), layout="constrained")
    panels = figure.subplots(tall, wide, squeeze=False).reshape(-1)
    for panel, name in zip(panels, shown, strict=False):
        _panel(panel, name, runs, steps_per_update)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    lines, labels = panels[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper center", ncols=len(runs), fontsize=8, frameon=False)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def _panel(panel: Any, name: str, runs: Mapping[str, Sequence[TrainingLog]], factor: int) -> None:
    for k, (label, logs) in enumerate(runs.items()):
        found = [curve for log in logs for curve in log.curves if curve.name == name]
        _run(panel, found, label, COLOURS[k % len(COLOURS)], factor)
    panel.set_title(_title(name), fontsize=9)
    panel.tick_params(labelsize=7)
    panel.set_xlabel("control steps" if factor > 1 else "updates", fontsize=8)
    panel.grid(alpha=0.25, lw=0.5)


def _run(panel: Any, seeds: Sequence[Curve], label: str, colour: str, factor: int) -> None:
    """Draw seeds thin and their mean thick; a single seed is drawn thin as measured and thick as smoothed."""
    for one in seeds:
        panel.plot(one.step * factor, one.value, color=colour, lw=0.6, alpha=0.45)
    at, mean = _mean(seeds)
    panel.plot(at * factor, smoothed(mean), color=colour, lw=1.8, label=label)


def _mean(seeds: Sequence[Curve]) -> tuple[np.ndarray, np.ndarray]:
    """Return (k,) steps that all seeds have reached, and the mean there."""
    known = [one for one in seeds if len(one.step)]
    if not known:
        return np.zeros(0), np.zeros(0)
    low, high = max(one.step[0] for one in known), min(one.step[-1] for one in known)
    at = np.linspace(low, high, min(FINEST, max(len(one.step) for one in known)))
    return at, np.mean([np.interp(at, one.step, one.value) for one in known], axis=0)


def smoothed(value: np.ndarray) -> np.ndarray:
    """Smooth (k,) values by a moving average whose window narrows at the ends."""
    half = int(SMOOTH * len(value))
    total = np.concatenate([[0.0], np.cumsum(value)])
    k = np.arange(len(value))
    reach = np.minimum(half, np.minimum(k, len(value) - 1 - k))
    found: np.ndarray = (total[k + reach + 1] - total[k - reach]) / (2 * reach + 1)
    return found


def _shown(runs: Mapping[str, Sequence[TrainingLog]]) -> list[str]:
    """Return the names of TITLES in their order, then nonzero rewards of any run; a term without a weight is 0 throughout."""
    curves = [curve for logs in runs.values() for log in logs for curve in log.curves]
    known = sorted({curve.name for curve in curves if REWARD not in curve.name or np.any(curve.value)})
    first = [name for word in TITLES for name in known if _word(name) == word and REWARD not in name]
    return first + [name for name in known if REWARD in name]


def _title(name: str) -> str:
    return TITLES.get(_word(name), _word(name)) if REWARD not in name else f"reward: {_word(name)}"


def _word(name: str) -> str:
    return name.replace("/", ".").replace(f"{REWARD}_", f"{REWARD}.").rpartition(".")[2]
