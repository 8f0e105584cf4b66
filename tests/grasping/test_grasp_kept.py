"""Policies that were trained apart become one table: means over seeds as if they had been together, newer figures win."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.evaluate.result_cells import group_cells, result_rows, scores
from benchmarks import grasp_kept
from schemas.episodes import GraspEpisodes

NAMES = ("success", "held", "hls", "log_jerk", "as_violation_pct", "as_safe_count", "negative_contact_end", "negative_contact_any")


def episodes(policy: str, seed: int, level: str = "train", engine: str = "bullet") -> GraspEpisodes:
    """Eight of them."""
    rng = np.random.default_rng(seed)
    values = rng.random((8, len(NAMES)))
    values[:, 0] = values[:, 0] < 0.7
    return GraspEpisodes(f"{policy}-{level}-{engine}", policy, level, engine, seed, ("a/cut",) * 8, NAMES, values,
                         rng.random((8, 4)) / 1000, ())  # fmt: skip


def kept(*runs: GraspEpisodes) -> grasp_kept.Kept:
    return {name: {"commit": "aaa", "figures": figures} for name, figures in scores(runs).items()}


def mean_of(*runs: GraspEpisodes) -> grasp_kept.Kept:
    """Merge runs to one entry of the seeds 0, 1, ..."""
    row = result_rows(group_cells(runs))[0]
    return {f"{row.policy}-0..{len(runs) - 1}-{row.level}-{row.engine}": {"commit": "aaa", "figures": dict(row.figures)}}


@pytest.mark.parametrize("together", [1, 2, 3])
def test_seeds_that_were_trained_apart_give_the_line_of_those_trained_together(together: int) -> None:
    """Either each seed is known, or only the mean of the first seeds."""
    runs = [episodes("teacher", seed) for seed in range(3)]
    known = mean_of(*runs[:together]) | kept(*runs[together:])
    (row,), (asked,) = grasp_kept.rows(known), result_rows(group_cells(runs))
    assert row.seeds == asked.seeds == 3 and row.figures.keys() == asked.figures.keys()
    assert list(row.figures.values()) == pytest.approx([asked.figures[name] for name in row.figures], abs=1e-12)


def test_a_run_replaces_what_was_known_of_its_seeds(tmp_path: Path) -> None:
    """A mean only when all of its seeds are there; what another machine has trained stays."""
    runs = [episodes("teacher", seed) for seed in range(2)]
    path, told = tmp_path / "kept.json", tmp_path / "scores.json"
    path.write_text(json.dumps(mean_of(*runs) | kept(episodes("prior", 0), episodes("teacher", 0, "unseen_size"))))
    told.write_text(json.dumps(scores([runs[0], episodes("prior", 0), episodes("lambda_half", 1)])))
    known = grasp_kept.add(path, told, "bbb")
    commits = {name: one["commit"] for name, one in known.items()}
    assert known == json.loads(path.read_text()) and commits == {
        "teacher-0..1-train-bullet": "aaa", "teacher-0-unseen_size-bullet": "aaa", "prior-0-train-bullet": "bbb",
        "lambda_half-1-train-bullet": "bbb"}  # fmt: skip
    assert grasp_kept.add(path, told, "ccc", ["lambda_half"])["prior-0-train-bullet"]["commit"] == "bbb"
    told.write_text(json.dumps(scores(runs)))
    assert {"teacher-0-train-bullet", "teacher-1-train-bullet"} == {
        name for name in grasp_kept.add(path, told, "ccc") if name.startswith("teacher") and "-train-" in name}  # fmt: skip


def test_the_table_is_of_all_of_them() -> None:
    """Rows are in the order of the recipes; rows that lack seeds are marked; conditions and the prior are listed once."""
    every = (("prior", 0), ("lambda_half", 1), ("lambda_half", 0), ("teacher_pushed", 0), ("teacher", 0, "unseen_size"),
             ("teacher", 0, "train", "mujoco"), ("teacher", 0))  # fmt: skip
    known = kept(*(episodes(*one) for one in every))
    known["lambda_half-1-train-bullet"]["commit"] = "bbb"
    text = grasp_kept.table(known)
    lines = [[word.strip() for word in line.split("|")[1:-1]] for line in text.partition("Beside")[0].splitlines() if "| " in line]
    assert [(line[0], line[1], line[2]) for line in lines[1:]] == [
        ("teacher", "train", "bullet"), ("teacher", "train", "mujoco"), ("teacher", "unseen_size", "bullet"),
        ("lambda_half", "train", "bullet"), ("prior", "train", "bullet"), ("teacher_pushed", "train", "bullet")]  # fmt: skip
    assert [line[-1] for line in lines[3:]] == ["1 of 3, not finished", "2 of 3, not finished", "1", "1"]
    assert text.startswith("Trained at the commits aaa, bbb.") and "| lambda_n | -5 | lambda_half |" in text
