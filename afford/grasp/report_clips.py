"""What the prior is worth: how near it comes to clips that it has never seen, and what it adds to a training of equal length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from afford.grasp.recipes import TEACHER
from schemas.episodes import ClipsFollowed, GraspEpisodes
from schemas.training import TrainingLog

MAIN = "bullet"
"""the engine whose figures have no prefix"""
MM, PCT = 1000.0, 100.0
WITHOUT = "naa_only"
"""the training that differs from the teacher in having no prior, and what that entails (recipes.ALONE)"""
COMPARED = {"succ": "success", "jerk": "log_jerk", "hls": "hls", "as_violation_pct": "as_violation_pct"}
"""name in metrics -> figure of an episode"""
WORDS = {"prior": "the prior", "clip": "motors that go where the clip goes", "still": "nobody"}


def tracking(found: Sequence[ClipsFollowed]) -> dict[str, float]:
    """hti.<figure>.<level> of the prior, hti.<follower>.<figure>.<level> of the others; names without a level are those of the
    training objects, an engine's name stands in front where that is not PyBullet."""
    out = dict[str, float]()
    for one, who, figures in _each(found):
        prefix = ("" if one.engine == MAIN else f"{one.engine}.") + ("hti." if who == "prior" else f"hti.{who}.")
        out |= {f"{prefix}{name}.{one.level}": value for name, value in figures.items()}
        out |= {f"{prefix}{name}": value for name, value in figures.items()} if one.level == "train" else {}
    return out


def ablation(episodes: Sequence[GraspEpisodes], logs: Sequence[TrainingLog]) -> dict[str, float]:
    """hti.<figure>_with and _without: the teacher against the same training without a prior, on training objects, over the seeds
    that both have; nothing where there is none. ValueError when they did not learn from equally many updates."""
    out = dict[str, float]()
    for engine in dict.fromkeys(one.engine for one in episodes):
        by = {policy: {one.seed: one for one in episodes if (one.policy, one.level, one.engine) == (policy, "train", engine)}
              for policy in (TEACHER, WITHOUT)}  # fmt: skip
        seeds = sorted(set(by[TEACHER]) & set(by[WITHOUT]))
        _equally_long(logs, seeds)
        prefix = "hti." if engine == MAIN else f"{engine}.hti."
        for name, figure in COMPARED.items() if seeds else ():
            for word, policy in (("with", TEACHER), ("without", WITHOUT)):
                out[f"{prefix}{name}_{word}"] = float(np.mean([np.nanmean(by[policy][seed].figure(figure)) for seed in seeds]))
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
                f"`{TEACHER}` and `{WITHOUT}` after equally many updates of PPO, training objects.", "",
                "| engine | | Succ % | log jerk | HLS | AS %, all |", "|---|---|--:|--:|--:|--:|"]  # fmt: skip
    for prefix in [p for p in ("", "mujoco.") if f"{p}hti.succ_with" in compared]:
        for word in ("with", "without"):
            succ, jerk, hls, unsafe = (compared[f"{prefix}hti.{name}_{word}"] for name in COMPARED)
            out.append(f"| {prefix[:-1] or MAIN} | {word} | {PCT * succ:.1f} | {jerk:.1f} | {hls:.1f} | {unsafe:.1f} |")
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


def _equally_long(logs: Sequence[TrainingLog], seeds: Sequence[int]) -> None:
    steps = {log.name: log.steps for log in logs}
    for seed in seeds:
        both = [steps.get(f"{row}-{seed}") for row in (TEACHER, WITHOUT)]
        if both[0] != both[1]:
            raise ValueError(f"grasp_report, {WITHOUT}-{seed}: expected as many updates as {TEACHER}-{seed}, got {both[1]} and "
                             f"{both[0]}; train both with the same rl_grasp_refinement.updates")
