"""Scores of detected hands against the truth of a clip: recall, precision, sides, touched objects and keypoints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.common.masks import iou
from benchmarks.hands.clip_truth import ClipTruth

GOOD_IOU = 0.5
SMALL = 200 / (1280 * 720)
"""share of the picture below which an annotated hand is not asked for and a match with it does not count"""
BIG_THING = 600 / (1280 * 720)
WRIST, MIDDLE_TIP = 0, 12
PALM = (0, 5, 9, 13, 17)


@dataclass(frozen=True, eq=False)
class Found:
    """Detection in one frame. Masks of any size; `side` left or right, or '' where it is not claimed."""

    mask: np.ndarray
    side: str = ""
    contact: bool | None = None
    thing: np.ndarray | None = None
    keypoints_px: np.ndarray | None = None
    """(21, 2), in pixels of `mask`"""
    keypoints_m: np.ndarray | None = None
    """(21, 3), camera frame"""
    focal_share: float = 0.0
    """focal length assumed for keypoints_m as a share of the picture's width; 0 for the true one"""


@dataclass
class Score:
    """Counts over frames; ratios are properties."""

    annotated: int = 0
    found: int = 0
    sided: int = 0
    side_claims: int = 0
    claimed: int = 0
    true_claims: int = 0
    contacts: int = 0
    contacts_right: int = 0
    things: int = 0
    things_found: int = 0
    overlap: list[float] = field(default_factory=list)
    keypoint_error: list[float] = field(default_factory=list)
    """mean keypoint error of each matched hand, as a share of the distance from wrist to middle fingertip"""
    depth_error: list[float] = field(default_factory=list)
    """relative error of the palm's depth of each matched hand, after correction for the assumed focal length"""

    def __add__(self, other: Score) -> Score:
        return Score(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    @property
    def recall(self) -> float:
        """Share of the annotated hands that were found."""
        return self.found / self.annotated if self.annotated else float("nan")

    @property
    def precision(self) -> float:
        """Share of the detected masks that match an annotated hand."""
        return self.true_claims / self.claimed if self.claimed else float("nan")

    def line(self) -> str:
        """Format the score as one line."""
        def share(a: int, b: int) -> str:
            return f"{a}/{b}={a / b:.2f}" if b else "-"

        error = f"{np.mean(self.keypoint_error):.3f}" if self.keypoint_error else "-"
        depth = f"{np.median(self.depth_error):.3f}" if self.depth_error else "-"
        return (f"recall {share(self.found, self.annotated)} precision {share(self.true_claims, self.claimed)} "
                f"side {share(self.sided, self.side_claims)} touch {share(self.contacts_right, self.contacts)} "
                f"thing {share(self.things_found, self.things)} IoU {np.median(self.overlap or [0]):.2f} "
                f"keypoints {error} depth {depth}")


def score_clip(truth: ClipTruth, found: Mapping[int, list[Found]]) -> Score:
    """Score detections by frame number; an annotated frame without an entry has no detections."""
    total = Score()
    for t, frame in enumerate(truth.frame.tolist()):
        total += score_frame(truth, t, found.get(frame, []))
    return total


def score_frame(truth: ClipTruth, t: int, found: list[Found]) -> Score:
    """Score the detections of one annotated frame; each matches one hand at most.

    A detection that matches a hand too small to ask for is ignored. Detections are compared at their own size.
    """
    out = Score()
    sides = [n for n in (0, 1) if truth.hands[n, t].any()]
    floor = SMALL * truth.hands[0, t].size
    overlap = np.zeros((len(sides), len(found)))
    for i, n in enumerate(sides):
        for j, one in enumerate(found):
            overlap[i, j] = iou(one.mask, sized(truth.hands[n, t], one.mask.shape))
    pairs = [(i, j) for i, j in zip(*linear_sum_assignment(-overlap), strict=True) if overlap[i, j] >= GOOD_IOU]
    matched = dict(pairs)
    asked = [i for i, n in enumerate(sides) if truth.hands[n, t].sum() >= floor]
    ignored = {j for i, j in pairs if i not in asked}
    ignored |= {j for j in range(len(found)) for i in range(len(sides)) if i not in asked and overlap[i, j] > 0.1}
    out.annotated, out.claimed = len(asked), len(found) - len(ignored)
    out.overlap = [float(overlap[i].max(initial=0)) for i in asked]
    for i in asked:
        if i in matched:
            _compare(truth, t, sides[i], found[matched[i]], out)
    return out


def _compare(truth: ClipTruth, t: int, n: int, one: Found, out: Score) -> None:
    """Compare a matched detection with its hand."""
    out.found += 1
    out.true_claims += 1
    out.side_claims += bool(one.side)
    out.sided += one.side == ("left", "right")[n]
    if truth.contact_known[n, t] and one.contact is not None:
        touches = bool(truth.contact[n, t])
        out.contacts += 1
        out.contacts_right += one.contact == touches
        thing = truth.touched[n, t]
        if touches and thing.sum() >= BIG_THING * thing.size:
            out.things += 1
            out.things_found += one.thing is not None and iou(one.thing, sized(thing, one.thing.shape)) >= GOOD_IOU
    if truth.keypoints_known[n, t]:
        _points(truth.keypoints_px[n, t], truth.keypoints_m[n, t], truth.hands.shape[2:], one, out)


def _points(pixels: np.ndarray, metres: np.ndarray, shape: tuple[int, ...], one: Found, out: Score) -> None:
    inside = ((pixels >= 0) & (pixels < np.array(shape)[::-1])).all(1)
    if inside.sum() < 15 or inside.size == 0:
        return
    length = np.linalg.norm(pixels[MIDDLE_TIP] - pixels[WRIST])
    stretched = sum(np.linalg.norm(pixels[k] - pixels[k - 1]) for k in (10, 11, 12)) + np.linalg.norm(pixels[9] - pixels[0])
    if one.keypoints_px is not None:
        scale = shape[1] / one.mask.shape[1]
        gap = np.linalg.norm(one.keypoints_px * scale - pixels, axis=1)[inside].mean()
        out.keypoint_error.append(float(gap / max(length, 0.6 * stretched)))
    if one.keypoints_m is not None:
        true, depth = metres[list(PALM), 2].mean(), one.keypoints_m[list(PALM), 2].mean()
        if one.focal_share:
            depth *= focal_px(pixels, metres) / (one.focal_share * shape[1])
        out.depth_error.append(float(abs(depth / true - 1)))


def focal_px(pixels: np.ndarray, metres: np.ndarray) -> float:
    """Compute the focal length of the camera from the true keypoints of a hand, in the picture and in the camera frame."""
    rays = metres[:, :2] / metres[:, 2:]
    spread, seen = rays - rays.mean(0), pixels - pixels.mean(0)
    return float((spread * seen).sum() / (spread**2).sum())


def sized(mask: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Resize a mask by the majority of the area."""
    return np.asarray(cv2.resize(mask.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA) >= 0.5)
