"""Comparisons in the report: predicted N_t and A_t, the imitation prior, and one object with two tasks.

Predictions are compared with the truth, and by the effect of predicted N_t on fingertips. The prior is compared by its tracking
error on held-out clips and by trainings of equal length without it. Task pairs measure how far N_t shifts the grasp on the same
object.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import t as student

from afford.grasping.env.scenery import SAFE_M
from afford.grasping.evaluate.recipes import NO_NEGATIVE, TEACHER
from afford.grasping.evaluate.result_cells import MAIN, PCT
from schemas.episodes import ClipsFollowed, GraspEpisodes, TwoTasks
from schemas.grasp import GraspTask
from schemas.training import TrainingLog

SHOWN = f"{TEACHER}_naa"
"""policy that receives predictions; its counterpart has the same seed and level"""
AS = "as_violation_pct"


class Agreement(NamedTuple):
    """Agreement of N_t with the truth; NaN when there are no points to compare."""

    recall: float
    """share of the true negative points that have a point of N_t within 2 cm"""
    precision: float
    """share of N_t that has a true negative point within 2 cm"""


def agreement(task: GraspTask) -> Agreement:
    """Compare N_t with the points of the negative parts."""
    bad = [task.body.parts.index(part) for part in task.negative]
    true = task.body.points[np.isin(task.body.point_part, bad)].astype(np.float64)
    return Agreement(_near(true, task.N_t), _near(task.N_t, true))


def on_hold(task: GraspTask) -> float:
    """Return the share of A_t whose nearest surface point is on the part to hold; NaN when A_t is empty."""
    if not len(task.A_t):
        return float("nan")
    part = task.body.point_part[cKDTree(task.body.points).query(task.A_t)[1]]
    return float((part == task.body.parts.index(task.hold)).mean())


def positive_metrics(predicted: Sequence[GraspTask]) -> dict[str, float]:
    """Compute metrics `positive.` of tasks with predicted A_t; empty when there are none."""
    if not predicted:
        return {}
    shares = np.array([on_hold(one) for one in predicted])
    out = {"positive.tasks": float(len(predicted)), "positive.tasks_without_points": float(np.isnan(shares).sum()),
           "positive.on_hold": _mean(shares)}  # fmt: skip
    return {name: value for name, value in out.items() if np.isfinite(value)}


def positive_lines(predicted: Sequence[GraspTask]) -> list[str]:
    """Format the section of the report about A_t; empty without predictions."""
    if not predicted:
        return []
    found = positive_metrics(predicted)
    rows = (f"| tasks | {len(predicted)} |", f"| without a predicted point | {found['positive.tasks_without_points']:.0f} |",
            f"| % of the others' points on the part to hold | {_text(100 * found.get('positive.on_hold', np.nan))} |")
    return ["## A_t as predicted", "", "| tasks to learn on | |", "|---|--:|", *rows, ""]


def negative_metrics(predicted: Sequence[GraspTask], episodes: Sequence[GraspEpisodes]) -> dict[str, float]:
    """Compute metrics `naa.`; empty without predictions, and without means over nothing."""
    if not predicted:
        return {}
    recall, precision = np.array([agreement(one) for one in predicted]).T
    out = {"naa.tasks": float(len(predicted)), "naa.tasks_without_points": float(sum(not len(one.N_t) for one in predicted)),
           "naa.recall_2cm": _mean(recall), "naa.precision_2cm": _mean(precision)}  # fmt: skip
    out |= {f"naa.times_below.{engine}": rows[NO_NEGATIVE] / rows[SHOWN]
            for engine, rows in _compared(episodes).items() if NO_NEGATIVE in rows and rows[SHOWN]}  # fmt: skip
    return {name: value for name, value in out.items() if np.isfinite(value)}


def negative_lines(predicted: Sequence[GraspTask], episodes: Sequence[GraspEpisodes]) -> list[str]:
    """Format the section of the report about N_t; empty without predictions."""
    if not predicted:
        return []
    found = negative_metrics(predicted, episodes)
    out = ["## N_t as predicted", "", "AS % over successes on new shapes, judged by the truth, for one seed.",
            f"{TEACHER} and {SHOWN} are one policy, which is shown N_t in truth, or as it is predicted.", "",
            f"| engine | {TEACHER} | {SHOWN} | {NO_NEGATIVE} | times below |", "|---|--:|--:|--:|--:|"]  # fmt: skip
    for engine, rows in _compared(episodes).items():
        values = [_text(rows.get(policy, np.nan)) for policy in (TEACHER, SHOWN, NO_NEGATIVE)]
        out.append(f"| {engine} | {' | '.join(values)} | {_text(found.get(f'naa.times_below.{engine}', np.nan))} |")
    out += ["", f"{found['naa.tasks_without_points']:.0f} of {len(predicted)} tasks have no predicted point. Recall: forbidden",
             "points with a predicted one within 2 cm; precision: predicted points with a forbidden one within 2 cm.", "",
             "| task | predicted points | recall % | precision % |", "|---|--:|--:|--:|"]  # fmt: skip
    for one in predicted:
        out.append(f"| {one.name} | {len(one.N_t)} | {' | '.join(_text(100 * share) for share in agreement(one))} |")
    return [*out, ""]


def _compared(episodes: Sequence[GraspEpisodes]) -> dict[str, dict[str, float]]:
    """Return engine -> policy -> AS % over successes.

    Level and seed are those of the policy that receives predictions.
    """
    out = dict[str, dict[str, float]]()
    for shown in (one for one in episodes if one.policy == SHOWN):
        alike = [one for one in episodes if (one.engine, one.level, one.seed) == (shown.engine, shown.level, shown.seed)]
        out[shown.engine] = {one.policy: _mean(one.figure(AS)[one.figure("success") > 0]) for one in alike}
    return out


def _near(points: np.ndarray, others: np.ndarray) -> float:
    """Return the share of points (n, 3) that have one of others (m, 3) within 2 cm."""
    if not len(points):
        return float("nan")
    return float((cKDTree(others).query(points)[0] <= SAFE_M).mean()) if len(others) else 0.0


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _text(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""


MM = 1000.0
WITHOUT = {"without": "naa_only", "by_script": "on_script"}
"""word in metrics -> training that differs from the teacher in having no prior, with what that entails (recipes.ALONE), or in
having a scripted grasp instead (recipes.SCRIPT)"""
COLUMN = {"with": "with", "without": "without", "by_script": "a script instead"}
COMPARED = {"succ": "success", "jerk": "log_jerk", "hls": "hls", "as_violation_pct": "as_violation_pct"}
"""name in metrics -> figure of an episode"""
WORDS = {"prior": "the prior", "clip": "motors that go where the clip goes", "still": "nobody"}


def tracking_metrics(found: Sequence[ClipsFollowed]) -> dict[str, float]:
    """Compute hti.<figure>.<level> of the prior and hti.<follower>.<figure>.<level> of the baselines.

    Names without a level are those of the training objects; an engine other than PyBullet is a prefix.
    """
    out = dict[str, float]()
    for one, who, figures in _each(found):
        prefix = ("" if one.engine == MAIN else f"{one.engine}.") + ("hti." if who == "prior" else f"hti.{who}.")
        out |= {f"{prefix}{name}.{one.level}": value for name, value in figures.items()}
        out |= {f"{prefix}{name}": value for name, value in figures.items()} if one.level == "train" else {}
    return out


def prior_ablation(episodes: Sequence[GraspEpisodes], logs: Sequence[TrainingLog]) -> dict[str, float]:
    """Compute hti.<figure>_with, _without and _by_script: the teacher and the same training without a prior, on training objects.

    Figures are means over the seeds that all of them have; empty without a counterpart. ValueError for trainings of different
    lengths.
    """
    out = dict[str, float]()
    for engine in dict.fromkeys(one.engine for one in episodes):
        by = {word: {one.seed: one for one in episodes if (one.policy, one.level, one.engine) == (policy, "train", engine)}
              for word, policy in {"with": TEACHER, **WITHOUT}.items()}  # fmt: skip
        found = {word: runs for word, runs in by.items() if runs}
        seeds = sorted(set.intersection(*map(set, found.values()))) if {"with"} < set(found) else []
        _equally_long(logs, [WITHOUT[word] for word in found if word in WITHOUT], seeds)
        prefix = "hti." if engine == MAIN else f"{engine}.hti."
        out |= {f"{prefix}{name}_{word}": float(np.mean([np.nanmean(runs[seed].figure(figure)) for seed in seeds]))
                for word, runs in found.items() for name, figure in COMPARED.items() if seeds}  # fmt: skip
    return out


def clip_lines(found: Sequence[ClipsFollowed], compared: Mapping[str, float]) -> list[str]:
    """Format tracking errors and the ablation of the prior in Markdown; missing parts are left out."""
    out = list[str]()
    if found:
        out += ["## Clips that training never shows", "", "Distances to the clip, mean over fingers and steps: of the joints where",
                "fingers leave the palm (level 1), and one phalanx further (level 2). Followed: never 5 cm off after 50/60 s.", "",
                "| follower | objects | engine | level 1, mm | level 2, mm | both, mm | p95 of clips | fingertips, mm | followed % "
                "| clips |", "|---|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for one, who, f in _each(found):
        values = (f["level_1_mm"], f["level_2_mm"], f["tracking_mm"], f["tracking_mm_p95"], f["tips_mm"], PCT * f["followed"])
        out.append(f"| {WORDS[who]} | {one.level} | {one.engine} | {' | '.join(f'{v:.1f}' for v in values)} | {f['clips']:.0f} |")
    out += [""] if found else []
    if compared:
        out += ["## With and without the prior", "",
                f"`{TEACHER}` beside `{'` and `'.join(WITHOUT.values())}` after equally many updates of PPO, training objects.", "",
                "| engine | | Succ % | log jerk | HLS | AS %, all |", "|---|---|--:|--:|--:|--:|"]  # fmt: skip
    for prefix in [p for p in ("", "mujoco.") if f"{p}hti.succ_with" in compared]:
        for word in [word for word in COLUMN if f"{prefix}hti.succ_{word}" in compared]:
            succ, jerk, hls, unsafe = (compared[f"{prefix}hti.{name}_{word}"] for name in COMPARED)
            out.append(f"| {prefix[:-1] or MAIN} | {COLUMN[word]} | {PCT * succ:.1f} | {jerk:.1f} | {hls:.1f} | {unsafe:.1f} |")
    return [*out, ""] if compared else out


def _each(found: Sequence[ClipsFollowed]) -> Iterator[tuple[ClipsFollowed, str, dict[str, float]]]:
    """Yield every follower of every setting with its figures."""
    for one in found:
        for who in dict.fromkeys(one.follower):
            rows = np.array([name == who for name in one.follower])
            both = (one.level_1_m + one.level_2_m)[rows] / 2
            yield one, who, {
                "tracking_mm": float(MM * both.mean()), "tracking_mm_p95": float(MM * np.percentile(both, 95)),
                "level_1_mm": float(MM * one.level_1_m[rows].mean()), "level_2_mm": float(MM * one.level_2_m[rows].mean()),
                "tips_mm": float(MM * one.tips_m[rows].mean()), "followed": float(one.followed[rows].mean()),
                "clips": float(rows.sum())}  # fmt: skip


def _equally_long(logs: Sequence[TrainingLog], rows: Sequence[str], seeds: Sequence[int]) -> None:
    steps = {log.name: log.steps for log in logs}
    for row, seed in product(rows, seeds):
        both = [steps.get(f"{one}-{seed}") for one in (TEACHER, row)]
        if both[0] != both[1]:
            raise ValueError(f"grasp_report, {row}-{seed}: expected as many updates as {TEACHER}-{seed}, got {both[1]} and "
                             f"{both[0]}; train both with the same rl_grasp_refinement.updates")


def shifts_m(pairs: TwoTasks) -> tuple[list[str], np.ndarray]:
    """Compute the shift of the grasp on every object that was lifted in both tasks at least once: names and (k,) metres.

    The shift is how much farther from the first end the palm is when N_t is there than when N_t is at the other end; mean over
    pairs.
    """
    moved, both = pairs.along_m[:, 1] - pairs.along_m[:, 0], pairs.success.all(axis=1)
    names = [name for name in dict.fromkeys(pairs.body) if any(both & (np.array(pairs.body) == name))]
    return names, np.array([moved[both & (np.array(pairs.body) == name)].mean() for name in names])


def pair_figures(pairs: TwoTasks) -> dict[str, float]:
    """Compute the figures of task pairs; NaN with too few objects.

    Mean shift and its 95 % interval by Student's t over objects, share of objects whose grasp moved away, share of pairs lifted
    twice, number of objects.
    """
    mm = MM * shifts_m(pairs)[1]
    half = float(student.ppf(0.975, len(mm) - 1) * mm.std(ddof=1) / np.sqrt(len(mm))) if len(mm) > 1 else float("nan")
    mean = float(mm.mean()) if len(mm) else float("nan")
    return {"shift_mm": mean, "shift_mm_low": mean - half, "shift_mm_high": mean + half,
            "away": float((mm > 0).mean()) if len(mm) else float("nan"), "succ": float(pairs.success.all(axis=1).mean()),
            "objects": float(len(mm)), "pairs": float(len(pairs.body))}  # fmt: skip


def pair_metrics(found: Sequence[TwoTasks]) -> dict[str, float]:
    """Compute <policy>.two_tasks.<figure>, means over seeds; an engine other than PyBullet is a prefix."""
    out = dict[str, list[float]]()
    for one in found:
        prefix = "" if one.engine == MAIN else f"{one.engine}."
        for name, value in pair_figures(one).items():
            out.setdefault(f"{prefix}{one.policy}.two_tasks.{name}", []).append(value)
    return {name: float(np.mean(values)) for name, values in out.items()}


def pair_lines(found: Sequence[TwoTasks]) -> list[str]:
    """Format the section of the report about task pairs; empty without pairs."""
    if not found:
        return []
    out = ["## One object, two tasks", "", "The same object from the same start, with N_t at one end and at the other: how far",
           "along it the palm ends away from an end because N_t is there and not at the other one. N_t are 100 points of what is",
           "more than 2 cm from the centre of mass; 95 % interval over objects that were lifted in both.", "",
           "| policy | engine | shift, mm | from | to | objects with a shift above 0 % | lifted in both % | objects | pairs |",
           "|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for one in found:
        f = pair_figures(one)
        shift = " | ".join(_number(f[f"shift_mm{end}"]) for end in ("", "_low", "_high"))
        out.append(f"| {one.policy} | {one.engine} | {shift} | {_number(PCT * f['away'])} | "
                   f"{PCT * f['succ']:.1f} | {f['objects']:.0f} | {f['pairs']:.0f} |")  # fmt: skip
    return [*out, ""]


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""
