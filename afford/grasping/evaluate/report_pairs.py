"""One object, two tasks: how far the place of the grasp moves with N_t, over all pairs of a policy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from schemas.episodes import TwoTasks

MAIN = "bullet"
"""the engine whose figures have no prefix"""
MM, PCT = 1000.0, 100.0


def shifts_m(pairs: TwoTasks) -> tuple[list[str], np.ndarray]:
    """Names and (k,) of the objects lifted in both tasks at least once: how much farther from the first end the palm is when N_t is
    there than when N_t is at the other; mean over the pairs of an object.
    """
    moved, both = pairs.along_m[:, 1] - pairs.along_m[:, 0], pairs.success.all(axis=1)
    names = [name for name in dict.fromkeys(pairs.body) if any(both & (np.array(pairs.body) == name))]
    return names, np.array([moved[both & (np.array(pairs.body) == name)].mean() for name in names])


def figures(pairs: TwoTasks) -> dict[str, float]:
    """Mean and its 95 % interval by Student's t over objects, share of objects whose grasp moved away, share of pairs lifted twice,
    objects that count; NaN where too few do.
    """
    mm = MM * shifts_m(pairs)[1]
    half = float(student.ppf(0.975, len(mm) - 1) * mm.std(ddof=1) / np.sqrt(len(mm))) if len(mm) > 1 else float("nan")
    mean = float(mm.mean()) if len(mm) else float("nan")
    return {"shift_mm": mean, "shift_mm_low": mean - half, "shift_mm_high": mean + half,
            "away": float((mm > 0).mean()) if len(mm) else float("nan"), "succ": float(pairs.success.all(axis=1).mean()),
            "objects": float(len(mm)), "pairs": float(len(pairs.body))}  # fmt: skip


def metrics(found: Sequence[TwoTasks]) -> dict[str, float]:
    """<policy>.two_tasks.<figure>, an engine's name in front where that is not PyBullet; of several seeds the mean."""
    out = dict[str, list[float]]()
    for one in found:
        prefix = "" if one.engine == MAIN else f"{one.engine}."
        for name, value in figures(one).items():
            out.setdefault(f"{prefix}{one.policy}.two_tasks.{name}", []).append(value)
    return {name: float(np.mean(values)) for name, values in out.items()}


def lines(found: Sequence[TwoTasks]) -> list[str]:
    """Markdown; nothing where there is nothing."""
    if not found:
        return []
    out = ["## One object, two tasks", "", "The same object from the same start, with N_t at one end and at the other: how far",
           "along it the palm ends away from an end because N_t is there and not at the other one. N_t are 100 points of what is",
           "more than 2 cm from the centre of mass; 95 % interval over objects that were lifted in both.", "",
           "| policy | engine | shift, mm | from | to | objects with a shift above 0 % | lifted in both % | objects | pairs |",
           "|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for one in found:
        f = figures(one)
        shift = " | ".join(_text(f[f"shift_mm{end}"]) for end in ("", "_low", "_high"))
        out.append(f"| {one.policy} | {one.engine} | {shift} | {_text(PCT * f['away'])} | "
                   f"{PCT * f['succ']:.1f} | {f['objects']:.0f} | {f['pairs']:.0f} |")  # fmt: skip
    return [*out, ""]


def _text(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""
