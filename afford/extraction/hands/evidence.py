"""Evidence of a hand: regions of a finder's probabilities, each with the probability that it is a hand.

A logistic model over features of the region. Its weights were fitted by benchmarks/hands/finder.py on composites of rendered hands
on photographs, which no training shows.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import cv2
import numpy as np

SEED, GROW = 0.5, 0.3
"""a region is connected, above GROW everywhere, and above SEED somewhere"""
LEAST = 0.0006
"""smallest region, as a share of the picture area"""
BAND = 0.012
"""width of the bands inside and outside an outline, as a share of the picture width"""
ODDS_LIMIT = 6.0


@dataclass(frozen=True)
class Evidence:
    """Features of a region; all are about -3..3."""

    certainty: float
    """mean log odds of a hand inside, over 3"""
    best: float
    """log odds of the most certain tenth of its pixels, over 3"""
    edge: float
    """probability in the band inside the outline minus that in the band outside"""
    contrast: float
    """distance of the mean colours of both bands (Lab), over 30"""
    area: float
    """log10 of its share of the picture"""
    solidity: float
    """area over that of the convex hull"""
    border: float
    """share of its outline that lies on the border of the picture"""


NAMES = tuple(Evidence.__dataclass_fields__)
WEIGHTS = (3.94, 3.88, 2.75, 2.43, 0.33, 0.93, -0.55)
BIAS = -5.86
COLOUR_WEIGHT, MOTION_WEIGHT = 1.0, 1.0
"""weights (log odds) of agreeing with the hand colours of the clip, -1..1, and of moving, -1..1"""


@dataclass(frozen=True, eq=False)
class HandRegion:
    """Region of a picture and the probability that it is a hand."""

    mask: np.ndarray
    """(h, w) bool"""
    probability: float
    evidence: Evidence


def regions(probabilities: np.ndarray, rgb: np.ndarray, colour: np.ndarray | None = None,
            motion: np.ndarray | None = None) -> list[HandRegion]:  # fmt: skip
    """Find the regions of a picture that may be hands, the most probable first.

    probabilities: (h, w, 4) of left hand, right hand, touched object and sleeve, as `segment` returns them. rgb: (h, w, 3) uint8.
    colour, motion: (h, w) evidence of this clip, -1..1: agreement with the colours of certain hands, and motion against the
    background. An empty list, or low probabilities only, mean a picture without hands.
    """
    hand = np.clip(probabilities[..., 0] + probabilities[..., 1], 0, 1).astype(np.float32)
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    found = []
    for mask in split_regions(hand):
        evidence = measure(mask, hand, lab)
        odds = float(np.dot(WEIGHTS, astuple(evidence))) + BIAS
        for extra, weight in ((colour, COLOUR_WEIGHT), (motion, MOTION_WEIGHT)):
            odds += weight * float(extra[mask].mean()) if extra is not None else 0.0
        found.append(HandRegion(mask, float(1 / (1 + np.exp(-odds))), evidence))
    return sorted(found, key=lambda one: -one.probability)


def split_regions(hand: np.ndarray) -> list[np.ndarray]:
    """Masks (h, w) bool of the connected regions of a map of probabilities (h, w)."""
    count, label, stats, _ = cv2.connectedComponentsWithStats((hand > GROW).astype(np.uint8))
    sure = np.bincount(label[hand > SEED], minlength=count) > 0
    return [label == n for n in range(1, count) if sure[n] and stats[n, cv2.CC_STAT_AREA] >= LEAST * hand.size]


def measure(mask: np.ndarray, hand: np.ndarray, lab: np.ndarray) -> Evidence:
    """Measure a region (h, w) bool; hand: (h, w) probabilities; lab: (h, w, 3) colours."""
    reach = max(1, round(BAND * mask.shape[1]))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    solid = mask.astype(np.uint8)
    inner = mask & (cv2.erode(solid, kernel, borderValue=1) == 0)
    outer = ~mask & (cv2.dilate(solid, kernel) > 0)
    odds = np.clip(_logit(hand[mask]), -ODDS_LIMIT, ODDS_LIMIT)
    outlines, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate(outlines)[:, 0]
    last = np.array(mask.shape[::-1]) - 1
    hull = max(cv2.contourArea(cv2.convexHull(points)), 1.0)
    return Evidence(
        certainty=float(odds.mean()) / 3,
        best=float(np.quantile(odds, 0.9)) / 3,
        edge=float(hand[inner].mean() - hand[outer].mean()) if inner.any() and outer.any() else 0.0,
        contrast=float(np.linalg.norm(lab[inner].mean(0) - lab[outer].mean(0))) / 30 if inner.any() and outer.any() else 0.0,
        area=float(np.log10(mask.mean())),
        solidity=min(float(mask.sum()) / hull, 1.0),
        border=float(((points == 0) | (points == last)).any(1).mean()))  # fmt: skip


def _logit(probability: np.ndarray) -> np.ndarray:
    safe = np.clip(probability, 1e-4, 1 - 1e-4)
    return np.asarray(np.log(safe / (1 - safe)))
