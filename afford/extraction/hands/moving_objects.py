"""Objects that move with a hand, or that neither earlier nor later frames explain, outlined by GrabCut in one sampled frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction.hands.grip import Keypoints, grip_ring
from afford.extraction.hands.motion import SampledFrames
from afford.extraction.hands.object_evidence import EvidenceModel, HandMasks, all_hands
from afford.extraction.hands.refine import components, segment_grabcut
from schemas.video import SIDES, Hand

LIKELY = 3.0
"""mean log odds from which a piece apart from the hand may belong to its object"""
PIECE_PX, JOIN_PX, OPENING_PX, CLOSING_PX = 30, 10, 3, 5
"""least area of a piece; largest gap between pieces of an object; narrower bridges are cut, and narrower gaps are closed"""
LEAST_OVERLAP_PX, SHARE = 8, 0.15
"""least overlap of a piece with the surroundings of a hand, and its share of the largest overlap with any hand"""
ARM_PX, SLEEVE = 3, 1.0
"""a piece is part of a sleeve when it borders on a forearm, within this distance, by this share of its overlap with the grip"""
HOLE = 0.5
"""holes are filled up to this share of the area of the object"""
LARGEST = 0.35
"""largest object, as a share of the picture"""


def moving_objects(
    sampled: SampledFrames, k: int, odds: np.ndarray, arms: np.ndarray, hands: HandMasks, keypoints: Keypoints,
    evidence: EvidenceModel, reach_px: int, least_px: float,
) -> dict[Hand, np.ndarray]:
    """Segment what each hand holds in sampled frame k: side -> mask (h, w) bool; sides without an object are missing."""
    skin = all_hands(hands, k, odds.shape)
    if not skin.any():
        return {}
    far = cv2.distanceTransform((~skin).astype(np.uint8), cv2.DIST_L2, 3) > evidence.far_px
    rings = {side: grip_ring(hands[side][k], keypoints[side].at(k) if side in keypoints else None, reach_px)
             for side in SIDES if k in hands[side]}  # fmt: skip
    foreground = segment_grabcut(odds, sampled.rgb[k], skin | arms | far)
    free = _without_sleeves(foreground, arms, np.any(list(rings.values()), axis=0), sampled.rgb[k])
    pieces = [piece for piece in components(free, PIECE_PX, OPENING_PX) if not _sleeve(piece, arms, rings)]
    overlap = [{side: int((ring & piece).sum()) for side, ring in rings.items()} for piece in pieces]
    apart = [piece for piece, at in zip(pieces, overlap, strict=True)
             if max(at.values()) < LEAST_OVERLAP_PX and odds[piece].mean() > LIKELY]  # fmt: skip
    out = {}
    for side in rings:
        mine = [piece for piece, at in zip(pieces, overlap, strict=True)
                if at[side] >= max(LEAST_OVERLAP_PX, SHARE * max(at.values()))]  # fmt: skip
        if mine:
            joined = _joined(mine, apart)
            closed = erode(dilate(joined, CLOSING_PX), CLOSING_PX) & ~skin & ~arms
            whole = fill_holes(joined | closed, skin)
            if least_px <= whole.sum() <= LARGEST * whole.size:
                out[side] = whole
    return out


def _without_sleeves(foreground: np.ndarray, arms: np.ndarray, ring: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    """Remove the parts of the foreground (h, w) bool that belong to forearms rather than to the grip, by watershed."""
    grip, arm = foreground & ring & ~dilate(arms, ARM_PX), arms & dilate(foreground, ARM_PX)
    if not (grip.any() and arm.any()):
        return foreground
    markers = np.ones(foreground.shape, np.int32)
    markers[foreground] = 0
    markers[arm], markers[grip] = 2, 3
    flooded = cv2.watershed(np.ascontiguousarray(rgb), markers)
    return foreground & (flooded != 2)


def _sleeve(piece: np.ndarray, arms: np.ndarray, rings: Mapping[Hand, np.ndarray]) -> bool:
    """Test whether a piece borders on a forearm more than on the surroundings of the fingers."""
    beside = int((dilate(piece, ARM_PX) & arms).sum())
    return beside > SLEEVE * max(int((ring & piece).sum()) for ring in rings.values())


def _joined(mine: Sequence[np.ndarray], apart: Sequence[np.ndarray]) -> np.ndarray:
    """Join the pieces at a hand with near ones beyond it: fingers hide what connects them."""
    whole: np.ndarray = np.any(mine, axis=0)
    for piece in apart:
        if (dilate(piece, JOIN_PX) & whole).any():
            whole = whole | piece
    return whole


def fill_holes(mask: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """Fill the holes of an object (h, w) bool that it encloses alone or with the hand; the hand itself is not filled."""
    count, label, stats, _ = cv2.connectedComponentsWithStats((~(mask | hand)).astype(np.uint8), connectivity=4)
    outside = set(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]).tolist())
    holes = [i for i in range(1, count) if i not in outside and stats[i, cv2.CC_STAT_AREA] < HOLE * mask.sum()]
    return mask | np.isin(label, holes)
