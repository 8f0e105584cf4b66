"""What predictions are worth to a policy: how near N_t and A_t are to the truth, and what fingertips do that are shown N_t."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from afford.grasping.env.scenery import SAFE_M
from afford.grasping.evaluate.recipes import NO_NEGATIVE, TEACHER
from schemas.episodes import GraspEpisodes
from schemas.grasp import GraspTask

SHOWN = f"{TEACHER}_naa"
"""name of the policy that is shown predictions; what it is compared with has its seed and level"""
AS = "as_violation_pct"


class Agreement(NamedTuple):
    """How near N_t is to the truth; NaN where there are no points to ask about."""

    recall: float
    """share of the points that must not be touched, in truth, that have one of N_t within 2 cm"""
    precision: float
    """share of N_t that has a point that must not be touched, in truth, within 2 cm"""


def agreement(task: GraspTask) -> Agreement:
    """N_t beside the points of the parts that must not be touched."""
    bad = [task.body.parts.index(part) for part in task.negative]
    true = task.body.points[np.isin(task.body.point_part, bad)].astype(np.float64)
    return Agreement(_near(true, task.N_t), _near(task.N_t, true))


def on_hold(task: GraspTask) -> float:
    """Share of A_t whose nearest point of the surface is of the part to hold; NaN where A_t is empty."""
    if not len(task.A_t):
        return float("nan")
    part = task.body.point_part[cKDTree(task.body.points).query(task.A_t)[1]]
    return float((part == task.body.parts.index(task.hold)).mean())


def positive_metrics(predicted: Sequence[GraspTask]) -> dict[str, float]:
    """Flat, `positive.`, of tasks whose A_t was predicted; nothing where there are none."""
    if not predicted:
        return {}
    shares = np.array([on_hold(one) for one in predicted])
    out = {"positive.tasks": float(len(predicted)), "positive.tasks_without_points": float(np.isnan(shares).sum()),
           "positive.on_hold": _mean(shares)}  # fmt: skip
    return {name: value for name, value in out.items() if np.isfinite(value)}


def positive_lines(predicted: Sequence[GraspTask]) -> list[str]:
    """The section of the report; none where nothing was predicted."""
    if not predicted:
        return []
    found = positive_metrics(predicted)
    rows = (f"| tasks | {len(predicted)} |", f"| without a predicted point | {found['positive.tasks_without_points']:.0f} |",
            f"| % of the others' points on the part to hold | {_text(100 * found.get('positive.on_hold', np.nan))} |")
    return ["## A_t as predicted", "", "| tasks to learn on | |", "|---|--:|", *rows, ""]


def metrics(predicted: Sequence[GraspTask], episodes: Sequence[GraspEpisodes]) -> dict[str, float]:
    """Flat, `naa.`; nothing where nothing was predicted, and no mean where there is nothing to take it of."""
    if not predicted:
        return {}
    recall, precision = np.array([agreement(one) for one in predicted]).T
    out = {"naa.tasks": float(len(predicted)), "naa.tasks_without_points": float(sum(not len(one.N_t) for one in predicted)),
           "naa.recall_2cm": _mean(recall), "naa.precision_2cm": _mean(precision)}  # fmt: skip
    out |= {f"naa.times_below.{engine}": rows[NO_NEGATIVE] / rows[SHOWN]
            for engine, rows in _compared(episodes).items() if NO_NEGATIVE in rows and rows[SHOWN]}  # fmt: skip
    return {name: value for name, value in out.items() if np.isfinite(value)}


def lines(predicted: Sequence[GraspTask], episodes: Sequence[GraspEpisodes]) -> list[str]:
    """The section of the report; none where nothing was predicted."""
    if not predicted:
        return []
    found = metrics(predicted, episodes)
    said = ["## N_t as predicted", "", "AS % over successes on new shapes, judged by the truth, for one seed.",
            f"{TEACHER} and {SHOWN} are one policy, which is shown N_t in truth, or as it is predicted.", "",
            f"| engine | {TEACHER} | {SHOWN} | {NO_NEGATIVE} | times below |", "|---|--:|--:|--:|--:|"]  # fmt: skip
    for engine, rows in _compared(episodes).items():
        values = [_text(rows.get(policy, np.nan)) for policy in (TEACHER, SHOWN, NO_NEGATIVE)]
        said.append(f"| {engine} | {' | '.join(values)} | {_text(found.get(f'naa.times_below.{engine}', np.nan))} |")
    said += ["", f"{found['naa.tasks_without_points']:.0f} of {len(predicted)} tasks have no predicted point. Recall: forbidden",
             "points with a predicted one within 2 cm; precision: predicted points with a forbidden one within 2 cm.", "",
             "| task | predicted points | recall % | precision % |", "|---|--:|--:|--:|"]  # fmt: skip
    for one in predicted:
        said.append(f"| {one.name} | {len(one.N_t)} | {' | '.join(_text(100 * share) for share in agreement(one))} |")
    return [*said, ""]


def _compared(episodes: Sequence[GraspEpisodes]) -> dict[str, dict[str, float]]:
    """Engine -> policy: AS % over successes, on the level and with the seed of the policy that is shown predictions."""
    out = dict[str, dict[str, float]]()
    for shown in (one for one in episodes if one.policy == SHOWN):
        alike = [one for one in episodes if (one.engine, one.level, one.seed) == (shown.engine, shown.level, shown.seed)]
        out[shown.engine] = {one.policy: _mean(one.figure(AS)[one.figure("success") > 0]) for one in alike}
    return out


def _near(points: np.ndarray, others: np.ndarray) -> float:
    """Share of points (n, 3) that have one of others (m, 3) within 2 cm."""
    if not len(points):
        return float("nan")
    return float((cKDTree(others).query(points)[0] <= SAFE_M).mean()) if len(others) else 0.0


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _text(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""
