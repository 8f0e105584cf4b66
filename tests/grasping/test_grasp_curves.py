"""Curves of trainings: a panel for each, a line for each seed, means where all seeds are, one picture for the same numbers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.grasping.evaluate.training_curves import COLOURS, smoothed, write_curves
from schemas.training import Curve, TrainingLog


def log(high: float, seed: int = 0, names: tuple[str, ...] = ("train.success", "train.reward/tips", "train.kl")) -> TrainingLog:
    """Rising curves."""
    step = np.arange(1, 41)
    noise = np.random.default_rng(seed).normal(0, 0.02, len(step))
    return TrainingLog(f"run-{seed}", tuple(Curve(name, step, high * step / 40 + noise) for name in names), 40, 40)


def drawn(path: Path) -> np.ndarray:
    """RGB."""
    return cv2.imread(str(path))[..., ::-1]


def test_runs_have_their_colours(tmp_path: Path) -> None:
    """Panels of success and of the reward, none of what nobody asked for; both runs are seen in each."""
    runs = {"with": [log(0.9, 0), log(0.8, 1)], "without": [log(0.4, 2)]}
    write_curves(tmp_path / "two.png", runs, 1000)
    write_curves(tmp_path / "three.png", runs, 1000, ("train.success", "train.reward/tips", "train.kl"))
    two, three = drawn(tmp_path / "two.png"), drawn(tmp_path / "three.png")
    assert three.shape[1] == round(two.shape[1] * 1.5)
    for half in np.split(two, 2, axis=1):
        for colour in COLOURS[:2]:
            wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
            assert (np.abs(half.astype(int) - wanted).max(axis=2) < 12).sum() > 100


def test_the_same_numbers_give_the_same_picture(tmp_path: Path) -> None:
    """To the byte; other numbers another one."""
    for name, high in (("a", 0.9), ("b", 0.9), ("c", 0.5)):
        write_curves(tmp_path / f"{name}.png", {"run": [log(high)]})
    a, b, c = ((tmp_path / f"{name}.png").read_bytes() for name in "abc")
    assert a == b != c


def test_seeds_that_stopped_early_end_the_mean(tmp_path: Path) -> None:
    """A seed of ten steps and one of forty: drawn as they are; a log without the curve is left out."""
    short = TrainingLog("short", (Curve("train.success", np.arange(1, 11), np.zeros(10)),), 10, 10)
    write_curves(tmp_path / "x.png", {"run": [log(0.9), short, log(0.9, 3, ("train.kl",))]})
    assert drawn(tmp_path / "x.png").std() > 5


def test_a_term_that_nobody_pays_has_no_panel(tmp_path: Path) -> None:
    """0 in every run; where one run pays it, it is shown."""
    at = np.arange(40)
    curves = [(Curve("train.success", at, at / 40), Curve("train.reward/positive", at, np.full(40, paid))) for paid in (0.0, -0.1)]
    unpaid, paid = (TrainingLog("x", found, 40, 40) for found in curves)
    write_curves(tmp_path / "none.png", {"run": [unpaid]})
    write_curves(tmp_path / "one.png", {"run": [unpaid], "other": [paid]})
    assert drawn(tmp_path / "one.png").shape[1] == 2 * drawn(tmp_path / "none.png").shape[1]


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected curves of success, AS or rewards, got none in run"):
        write_curves(tmp_path / "x.png", {"run": [log(0.9, 0, ("train.kl",))]})


def test_smoothing_keeps_lines_and_means() -> None:
    """A straight line stays, ends included; noise shrinks."""
    line = np.linspace(0, 1, 200)
    noise = np.random.default_rng(0).normal(size=200)
    assert np.allclose(smoothed(line), line) and smoothed(noise).std() < 0.5 * noise.std()
