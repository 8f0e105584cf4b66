"""What the prior is worth: how near it comes to clips that it has never seen, and what it adds to a training of equal length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from afford.grasping.evaluate.recipes import TEACHER
from schemas.episodes import ClipsFollowed, GraspEpisodes
from schemas.training import TrainingLog

MAIN = "bullet"
"""the engine whose figures have no prefix"""
MM, PCT = 1000.0, 100.0
WITHOUT = {"without": "naa_only", "by_script": "on_script"}
"""word in metrics -> the training that differs from the teacher in having no prior, and what that entails (recipes.ALONE), or in
having a grasp by script instead (recipes.SCRIPT), which nobody has shown it"""
COLUMN = {"with": "with", "without": "without", "by_script": "a script instead"}
COMPARED = {"succ": "success", "jerk": "log_jerk", "hls": "hls", "as_violation_pct": "as_violation_pct"}
"""name in metrics -> figure of an episode"""
WORDS = {"prior": "the prior", "clip": "motors that go where the clip goes", "still": "nobody"}


def tracking(found: Sequence[ClipsFollowed]) -> dict[str, float]:
    """hti.<figure>.<level> of the prior, hti.<follower>.<figure>.<level> of the others; names without a level are those of the
    training objects, an engine's name stands in front where that is not PyBullet.
    """
    out = dict[str, float]()
    for one, who, figures in _each(found):
        prefix = ("" if one.engine == MAIN else f"{one.engine}.") + ("hti." if who == "prior" else f"hti.{who}.")
        out |= {f"{prefix}{name}.{one.level}": value for name, value in figures.items()}
        out |= {f"{prefix}{name}": value for name, value in figures.items()} if one.level == "train" else {}
    return out


def ablation(episodes: Sequence[GraspEpisodes], logs: Sequence[TrainingLog]) -> dict[str, float]:
    """hti.<figure>_with, _without and _by_script: the teacher against the same training without a prior, on training objects, over
    the seeds that all of them have; nothing where there is none to compare. ValueError when they did not learn from equally many
    updates.
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


def lines(found: Sequence[ClipsFollowed], compared: Mapping[str, float]) -> list[str]:
    """Markdown of both; nothing of what is not there."""
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
    """Every follower of every setting, with its figures."""
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
