"""Evidence for touched objects in sampled frames: neither background nor hand, and motion with the hand, over time, in log odds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.hands.forearm import forearms
from afford.extraction.hands.grip import Keypoints
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.motion import SampledFrames, comotion, propagate_odds
from afford.extraction.hands.still_background import StillBackground, Unexplained
from schemas.video import SIDES, Hand

HandMasks = Mapping[Hand, Mapping[int, np.ndarray]]
"""side -> sampled frame -> mask (h, w) bool"""
MARGIN_PX = 5
"""hands are dilated by this before their pixels are excluded from the background"""
FULL, POSSIBLE, BACKGROUND = 0.5, (0.1, 0.4), 0.15
"""unexplained shares: of a certain foreground pixel; from none to full weight of motion; below which a pixel is background"""
BIAS, STILL_WEIGHT, HAND_ODDS = 1.0, 0.3, -4.0
"""log odds against an object without evidence; weight of resting beside a moving hand; log odds of pixels of hands and arms"""
MIN_PROBABILITY = 0.2
"""probabilities of the hand finder are clipped to this value and 1 minus it: it was trained on few objects"""
ARM_OFFSETS = (2, 5, 10)
"""distances, in sampled frames, of the frames that show the background of an arm"""


@dataclass(frozen=True)
class EvidenceModel:
    """Weights of the evidence, in log odds, and its range."""

    foreground: float
    """weight of what neither earlier nor later frames explain"""
    motion: float
    """weight of motion with the hand"""
    sleeve: float
    """log odds against an object where the hand finder is certain of a sleeve"""
    lasting: float
    """weight of the odds of the previous sampled frame"""
    far_px: float
    """largest distance from the hand at which evidence counts"""
    facing: bool
    """the person is seen from the front"""
    held: float = 0.8
    """weight of the network of held objects (log odds)"""


def object_odds(
    sampled: SampledFrames, hands: HandMasks, keypoints: Keypoints, model: EvidenceModel,
    touched: np.ndarray | None = None, sleeve: np.ndarray | None = None, held: Sequence[HeldEvidence] | None = None,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Compute the log odds (h, w) float32 of a touched object, and the forearms and sleeves (h, w) bool, in every sampled frame.

    touched, sleeve: (k, h, w) probabilities of the hand finder, None without one; then the forearm is a strip behind the wrist.
    held: evidence of the network of held objects for every sampled frame, None without one.
    """
    own: list[np.ndarray] = []
    arms: list[np.ndarray] = []
    for run in sampled.runs:
        skin = [all_hands(hands, k, sampled.rgb.shape[1:3]) for k in run]
        background = StillBackground(sampled, run, [dilate(mask, MARGIN_PX) for mask in skin])
        cloth = _arms(background, run, hands, keypoints, model.facing) if sleeve is None else [sleeve[k] > 0.5 for k in run]
        background.exclude([dilate(mask | other, MARGIN_PX) for mask, other in zip(skin, cloth, strict=True)])
        arms += cloth
        for i, k in enumerate(run):
            odds = np.zeros(skin[i].shape, np.float32)
            if skin[i].any():
                found = background.unexplained(i)
                odds = _frame_odds(found, sampled, k, hands, model) + _finder_odds(k, touched, sleeve, model.sleeve)
                odds = odds if held is None else odds + model.held * held[k].odds
                odds = np.where(skin[i] | cloth[i], HAND_ODDS, odds).astype(np.float32)
            own.append(odds)
    return propagate_odds(own, sampled, model.lasting), arms


def all_hands(hands: HandMasks, k: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return the union (h, w) bool of the hands of a sampled frame."""
    return np.any([np.zeros(shape, bool), *(hands[side][k] for side in SIDES if k in hands[side])], axis=0)


def _arms(background: StillBackground, run: range, hands: HandMasks, keypoints: Keypoints, facing: bool) -> list[np.ndarray]:
    """Mark the forearms (h, w) bool of all hands in every frame of a run."""
    size = background.shape[::-1]
    fore = [cv2.resize(found.both, size) for found in (background.unexplained(i, ARM_OFFSETS) for i in range(len(run)))]
    masks = [[hands[side].get(k) for k in run] for side in SIDES]
    points = [[keypoints[side].at(k) if side in keypoints else None for k in run] for side in SIDES]
    sign = -1 if facing else 1
    sides = [forearms(masks[i], points[i], masks[1 - i], fore, (sign * (2 * i - 1), sign)) for i in range(2)]
    return [left | right for left, right in zip(*sides, strict=True)]


def _frame_odds(found: Unexplained, sampled: SampledFrames, k: int, hands: HandMasks, model: EvidenceModel) -> np.ndarray:
    skin = all_hands(hands, k, sampled.rgb.shape[1:3])
    size = skin.shape[::-1]
    certain = np.clip(1 - found.either / BACKGROUND, 0, 1) * (found.count_before + found.count_after > 2)
    still = model.foreground * np.clip(found.both / FULL, 0, 1) - certain
    possible = np.clip((found.either - POSSIBLE[0]) / (POSSIBLE[1] - POSSIBLE[0]), 0, 1)
    still, possible = (cv2.resize(image.astype(np.float32), size) for image in (still, possible))
    along = np.max([comotion(sampled, k, hands[side][k], skin, model.far_px) for side in SIDES if k in hands[side]], axis=0)
    odds = still + model.motion * np.where(along > 0, along * possible, STILL_WEIGHT * along) - BIAS
    far = cv2.distanceTransform((~skin).astype(np.uint8), cv2.DIST_L2, 3) >= model.far_px
    return np.where(far, np.minimum(odds, 0), odds)


def _finder_odds(k: int, touched: np.ndarray | None, sleeve: np.ndarray | None, weight: float) -> np.ndarray:
    """Log odds of the hand finder, (h, w) or () float32; 0 without one."""
    odds = np.zeros((), np.float32)
    if touched is not None:
        p = np.clip(touched[k].astype(np.float32), MIN_PROBABILITY, 1 - MIN_PROBABILITY)
        odds = odds + np.log(p / (1 - p))
    return np.asarray(odds if sleeve is None else odds - weight * sleeve[k].astype(np.float32))
