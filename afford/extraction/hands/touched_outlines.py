"""Touched objects by promptable segmentation: outlines beside the fingers, ranked, and chosen over time, in all sampled frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.extraction.hands.grip import Keypoints
from afford.extraction.hands.motion import SampledFrames, comotion
from afford.extraction.hands.object_evidence import HandMasks, all_hands
from afford.extraction.hands.touch_candidates import Candidates, Grip, touch_candidates
from afford.extraction.hands.touch_paths import PathModel, fill_between, touch_path
from afford.extraction.prompted import Segmenter
from afford.extraction.tracks.key_frames import evenly_spaced
from schemas.video import SIDES, Hand


@dataclass(frozen=True)
class HandEvidence:
    """Hands of a clip and the evidence around them in all sampled frames."""

    hands: HandMasks
    keypoints: Keypoints
    odds: Sequence[np.ndarray]
    """log odds (h, w) float32 of a touched object"""
    arms: Sequence[np.ndarray]
    """forearms and sleeves (h, w) bool"""
    far_px: float
    """largest distance from the hand at which motion counts"""


def touched_outlines(
    sampled: SampledFrames, around: HandEvidence, segment: Segmenter, every_s: float, model: PathModel
) -> tuple[list[dict[Hand, np.ndarray]], list[int]]:
    """Find what each hand touches: in every sampled frame side -> mask (h, w) bool; and the frames with an unsure touch."""
    held: list[dict[Hand, np.ndarray]] = [{} for _ in sampled.at]
    unsure = set[int]()
    for run in sampled.runs:
        found = run_candidates(sampled, run, around, segment, every_s)
        skin = [all_hands(around.hands, k, sampled.rgb.shape[1:3]) for k in run]
        for side in SIDES:
            path = touch_path(found[side], sampled, model)
            unsure |= set(path.unsure)
            for k, mask in fill_between(path, around.hands[side], skin, sampled, run).items():
                held[k][side] = mask
    return held, sorted(unsure)


def run_candidates(
    sampled: SampledFrames, run: range, around: HandEvidence, segment: Segmenter, every_s: float
) -> dict[Hand, dict[int, Candidates]]:
    """Segment the frames of a run that are about `every_s` apart, at every visible hand."""
    out: dict[Hand, dict[int, Candidates]] = {side: {} for side in SIDES}
    for k in (run[i] for i in evenly_spaced(sampled.time_s[run.start : run.stop], every_s)):
        shown = [side for side in SIDES if k in around.hands[side]]
        if not shown:
            continue
        at = segment(sampled.rgb[k])
        for side in shown:
            out[side][k] = touch_candidates(at, grip_at(sampled, k, side, around))
    return out


def grip_at(sampled: SampledFrames, k: int, side: Hand, around: HandEvidence) -> Grip:
    """Collect what is known of a hand in a sampled frame that shows it."""
    hand, skin = around.hands[side][k], all_hands(around.hands, k, sampled.rgb.shape[1:3])
    points = around.keypoints[side].at(k) if side in around.keypoints else None
    return Grip(hand, skin, around.arms[k], points, around.odds[k], comotion(sampled, k, hand, skin, around.far_px))
