"""Plots of training curves: panels, colours, means over seeds, determinism."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.grasping.evaluate.training_curves import COLOURS, smoothed, write_curves
from schemas.training import Curve, TrainingLog


def log(high: float, seed: int = 0, names: tuple[str, ...] = ("train.success", "train.reward/tips", "train.kl")) -> TrainingLog:
    """Build a log of rising curves."""
    step = np.arange(1, 41)
    noise = np.random.default_rng(seed).normal(0, 0.02, len(step))
    return TrainingLog(f"run-{seed}", tuple(Curve(name, step, high * step / 40 + noise) for name in names), 40, 40)


def drawn(path: Path) -> np.ndarray:
    """Read a picture as RGB."""
    return cv2.imread(str(path))[..., ::-1]


def test_colours_of_runs(tmp_path: Path) -> None:
    """Panels show success and the reward, other curves only on request; both runs are visible in each."""
    runs = {"with": [log(0.9, 0), log(0.8, 1)], "without": [log(0.4, 2)]}
    write_curves(tmp_path / "two.png", runs, 1000)
    write_curves(tmp_path / "three.png", runs, 1000, ("train.success", "train.reward/tips", "train.kl"))
    two, three = drawn(tmp_path / "two.png"), drawn(tmp_path / "three.png")
    assert three.shape[1] == round(two.shape[1] * 1.5)
    for half in np.split(two, 2, axis=1):
        for colour in COLOURS[:2]:
            wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
            assert (np.abs(half.astype(int) - wanted).max(axis=2) < 12).sum() > 100


def test_the_same_numbers_give_the_same_bytes(tmp_path: Path) -> None:
    """Seeds of ten and forty steps, and a log without the curve, give another picture."""
    short = TrainingLog("short", (Curve("train.success", np.arange(1, 11), np.zeros(10)),), 10, 10)
    without = log(0.9, 3, ("train.kl",))
    for name, seeds in (("a", [log(0.9)]), ("b", [log(0.9)]), ("c", [log(0.9), short, without])):
        write_curves(tmp_path / f"{name}.png", {"run": seeds})
    a, b, c = ((tmp_path / f"{name}.png").read_bytes() for name in "abc")
    assert a == b != c and drawn(tmp_path / "c.png").std() > 5


def test_a_zero_reward_term_has_no_panel(tmp_path: Path) -> None:
    """A term that is nonzero in one run is shown."""
    at = np.arange(40)
    curves = [(Curve("train.success", at, at / 40), Curve("train.reward/positive", at, np.full(40, paid))) for paid in (0.0, -0.1)]
    unpaid, paid = (TrainingLog("x", found, 40, 40) for found in curves)
    write_curves(tmp_path / "none.png", {"run": [unpaid]})
    write_curves(tmp_path / "one.png", {"run": [unpaid], "other": [paid]})
    assert drawn(tmp_path / "one.png").shape[1] == 2 * drawn(tmp_path / "none.png").shape[1]


def test_logs_without_curves_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no curves of success, AS or rewards in run"):
        write_curves(tmp_path / "x.png", {"run": [log(0.9, 0, ("train.kl",))]})


def test_smoothing_keeps_lines() -> None:
    """A straight line stays, ends included; noise shrinks."""
    line = np.linspace(0, 1, 200)
    noise = np.random.default_rng(0).normal(size=200)
    assert np.allclose(smoothed(line), line) and smoothed(noise).std() < 0.5 * noise.std()
