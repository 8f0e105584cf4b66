"""Fit the scores of candidates for touched objects on composite clips, and print the weights of touch_ranker.py.

    PYTHONPATH=. python benchmarks/hands/photographs.py     # once: backgrounds, by package name
    PYTHONPATH=. python benchmarks/hands/fit_touch.py [--clips ../hand-clips-fit] [--photographs DIR]

The clips have the seed of development; the figures of benchmarks/hand_detect.md come from others. A candidate counts as the touched
object from IoU 0.7 on, in proportion from 0.3. Prints the share of touched objects that the best candidate is, cross-validated by
clip, beside the share for which there is such a candidate at all.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
import torch
from scipy.optimize import minimize

from afford.common.masks import iou
from afford.extraction.hands import touched_outlines
from afford.extraction.hands.touch_candidates import FEATURES, Candidates
from afford.extraction.landmarks.files import landmark_files
from afford.extraction.prompted.files import segment_files
from benchmarks.hands import photographs
from benchmarks.hands.clip_truth import ClipTruth
from benchmarks.hands.detection import Models, run
from benchmarks.hands.scoring import BIG_THING, GOOD_IOU, sized
from benchmarks.hands.sources import Scene, make_pasted, pasted
from commands.session import digester, open_runner
from schemas.video import Hand

ROOT = Path(__file__).resolve().parents[2]
SEED, FOLDS, RIDGE = 101, 8, 0.03
FROM_IOU, TO_IOU = 0.3, 0.7


@dataclass(frozen=True, eq=False)
class Row:
    """Candidates of one hand in one annotated frame."""

    clip: str
    features: np.ndarray
    """(n, len(FEATURES))"""
    overlap: np.ndarray
    """(n,) IoU with the touched object; 0 without a touch"""
    asked: bool
    """whether the hand touches an object that is large enough"""


class Watch:
    """Keep the candidates of every run of sampled frames while a clip is detected."""

    def __init__(self) -> None:
        self.runs: list[tuple[np.ndarray, touched_outlines.HandEvidence, dict[Hand, dict[int, Candidates]]]] = []
        self._find = touched_outlines.run_candidates

    def __call__(self, sampled, run, around, segment, every_s):  # type: ignore[no-untyped-def]  # of run_candidates
        """Find the candidates, and keep them."""
        found = self._find(sampled, run, around, segment, every_s)
        self.runs.append((sampled.time_s, around, found))
        return found


def rows(scene: Scene, models: Models) -> Iterator[Row]:
    """Detect hands in a clip, and yield the candidates of those that match an annotated hand."""
    watch = Watch()
    with patch.object(touched_outlines, "run_candidates", watch):
        detected = run(scene.files, scene.truth.viewpoint, "landmarks", models)
    times = {int(frame): float(ns) / 1e9 for one in detected.frames for frame, ns in zip(one.frame, one.time_ns, strict=True)}
    at = np.array([times[int(frame)] for frame in scene.truth.frame])
    for time_s, around, found in watch.runs:
        for side, by_frame in found.items():
            for k, candidates in by_frame.items():
                t = int(np.abs(at - time_s[k]).argmin())
                row = _row(scene.truth, t, around.hands[side][k], candidates)
                if row is not None and abs(at[t] - time_s[k]) < 0.04:
                    yield row


def _row(truth: ClipTruth, t: int, hand: np.ndarray, found: Candidates) -> Row | None:
    match = [iou(hand, sized(truth.hands[n, t], hand.shape)) for n in (0, 1)]
    n = int(np.argmax(match))
    if match[n] < GOOD_IOU or not truth.contact_known[n, t]:
        return None
    thing, touches = sized(truth.touched[n, t], hand.shape), bool(truth.contact[n, t])
    if touches and thing.sum() < BIG_THING * thing.size:
        return None
    overlap = np.array([iou(mask, thing) if touches else 0.0 for mask in found.masks])
    return Row(truth.name, found.features.astype(np.float64), overlap, touches)


def fit(given: Sequence[Row]) -> np.ndarray:
    """Fit the weights (1 + len(FEATURES),) by logistic regression, the bias first; candidates of a frame share its weight."""
    shown = [row for row in given if len(row.features)]
    x = np.concatenate([row.features for row in shown])
    target = np.clip((np.concatenate([row.overlap for row in shown]) - FROM_IOU) / (TO_IOU - FROM_IOU), 0, 1)
    weight = np.concatenate([np.full(len(row.features), len(row.features) ** -0.5) for row in shown])
    weight /= weight.sum()
    mean, deviation = x.mean(0), x.std(0) + 1e-6
    z = np.concatenate([np.ones((len(x), 1)), (x - mean) / deviation], axis=1)

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        odds = z @ w
        error = weight * (1 / (1 + np.exp(-odds)) - target)
        ridge = RIDGE / len(w) * np.concatenate([[0.0], w[1:]])
        return float(weight @ (np.logaddexp(0, odds) - target * odds) + ridge @ w), z.T @ error + 2 * ridge

    w = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 400}).x
    return np.concatenate([[w[0] - (mean / deviation) @ w[1:]], w[1:] / deviation])


def cross_validated(given: Sequence[Row]) -> tuple[float, float, int]:
    """Compute the share of touched objects that the best candidate is, that of those with a right candidate, and their number."""
    names, best, possible = sorted({row.clip for row in given}), list[float](), list[float]()
    for fold in range(FOLDS):
        out = set(names[fold::FOLDS])
        weights = fit([row for row in given if row.clip not in out])
        for row in (row for row in given if row.clip in out and row.asked):
            best.append(float(row.overlap[np.argmax(row.features @ weights[1:])]) if len(row.features) else 0.0)
            possible.append(float(row.overlap.max(initial=0.0)))
    return float(np.mean(np.array(best) >= GOOD_IOU)), float(np.mean(np.array(possible) >= GOOD_IOU)), len(best)


def main() -> None:
    """Make the clips, find the candidates, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, default=ROOT.parent / "hand-clips-fit")
    parser.add_argument("--photographs", type=Path, default=photographs.DEFAULT)
    parser.add_argument("--store", type=Path)
    parser.add_argument("--count", type=int, default=32, help="composite clips of each kind")
    args = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    digest = digester(open_runner(args.store, jobs=1))
    models = Models(landmark_files(digest), None, segment=segment_files(digest))
    if models.landmarks is None or models.segment is None:
        parser.error("set-up has not fetched the networks; run install/landmark_files.py and install/segment_files.py")
    make_pasted(args.clips, args.photographs, args.photographs.parent, SEED, args.count)
    given = [row for kind in ("composite", "heldout") for scene in pasted(kind, args.clips, digest) for row in rows(scene, models)]
    best, possible, count = cross_validated(given)
    print(f"{len(given)} hands; of {count} touched objects {best:.2f} found by the best candidate, {possible:.2f} by any")
    bias, *weights = fit(given)
    print("WEIGHTS = {" + ", ".join(f'"{name}": {w:.3f}' for name, w in zip(FEATURES, weights, strict=True)) + "}")
    print(f"BIAS = {bias:.3f}")


if __name__ == "__main__":
    main()
