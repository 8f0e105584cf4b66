"""What hands touch: what the finder takes for it, and what moves as the hand does while the background does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.detect.follow import Piece, Track
from afford.detect.looks import Looks
from afford.detect.refine import along_edges, pieces
from afford.morphology import dilate
from schemas.hands import SIDES, Hand

Hands = Mapping[Hand, Mapping[int, np.ndarray]]
"""side -> look -> mask (h, w) bool"""
NOTHING = -1
DOUBT = 0.2
"""nothing that the finder says of things is surer than this: it knows few of them"""
HALO_PX = 7
"""narrower things are none: the flow of a hand reaches a little beyond its outline"""


@dataclass(frozen=True)
class Reach:
    """When a hand touches something."""

    ring_px: int
    """a hand dilated by this much touches what it overlaps"""
    far_px: float
    """farther from a hand than this, motion says nothing"""
    least_px: float
    """smallest part that is an object"""
    edge_px: int
    """radius of the guided filter"""
    motion: float
    """of motion, against 1 for what the finder says, in log odds"""


def held(seen: np.ndarray, looks: Looks, hands: Hands, reach: Reach) -> list[list[Piece]]:
    """The parts of every look that are objects beside a hand. seen: (k, h, w) probability of a touched object."""
    return [_held(seen[k], looks, k, [hands[side][k] for side in SIDES if k in hands[side]], reach) for k in range(len(looks.at))]


def _held(p: np.ndarray, looks: Looks, k: int, hands: Sequence[np.ndarray], reach: Reach) -> list[Piece]:
    if not hands:
        return []
    hand = np.any(hands, axis=0)
    sure = np.clip(p.astype(np.float32), DOUBT, 1 - DOUBT)
    odds = np.log(sure / (1 - sure)) + reach.motion * sum(_moves_along(looks, k, one, hand, reach.far_px) for one in hands)
    likely = along_edges(1 / (1 + np.exp(-odds)), looks.rgb[k], reach.edge_px)
    near = dilate(hand, reach.ring_px)
    found = [part for part in pieces((likely > 0.5) & ~hand, reach.least_px, HALO_PX) if (part & near).any()]
    return [Piece(part) for part in found if not _cut_off(part) or p[part].mean() > 0.5]


def _cut_off(part: np.ndarray) -> bool:
    """Whether a part goes on outside the picture. What moves along with a hand and does is its sleeve, as a rule."""
    return bool(part[0].any() or part[-1].any() or part[:, 0].any() or part[:, -1].any())


def _moves_along(looks: Looks, k: int, hand: np.ndarray, hands: np.ndarray, far_px: float) -> np.ndarray:
    """(h, w) float32: near 1 for what moves as a hand that moves, near -1 for what rests as the background does, else 0."""
    flow = looks.forth[k] if looks.forth[k] is not None else looks.back[k]
    if flow is None:
        return np.zeros(hand.shape, np.float32)
    size = flow.shape[1::-1]
    mine, any_hand = (cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0 for mask in (hand, hands))
    if not mine.any() or any_hand.all():
        return np.zeros(hand.shape, np.float32)
    own = flow - _background(flow, ~dilate(any_hand, 4))
    pace = np.median(own[mine], axis=0)
    speed = float(np.hypot(*pace))
    width = 0.35 * speed + 0.3
    along, rest = (np.exp(-(np.square(own - to).sum(-1)) / (2 * width**2)) for to in (pace, np.zeros(2, np.float32)))
    says = cv2.resize(((along - rest) * min(speed / 2, 1)).astype(np.float32), hand.shape[::-1])
    away = cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3)
    return says * (away < far_px)


def _background(flow: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(h, w, 2) flow of the camera's own motion: an affine map, fitted twice, the second time to what agreed with the first."""
    height, width = free.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    terms = np.stack([np.ones_like(x), x / width, y / height], -1)
    chosen = free[::4, ::4].ravel()
    if chosen.sum() < 16:
        return np.zeros_like(flow)
    a, b = terms[::4, ::4].reshape(-1, 3)[chosen], flow[::4, ::4].reshape(-1, 2)[chosen]
    off = np.hypot(*(b - np.median(b, axis=0)).T)
    for _ in range(2):
        kept = off <= np.quantile(off, 0.6)
        fit = np.linalg.lstsq(a[kept], b[kept], rcond=None)[0]
        off = np.hypot(*(b - a @ fit).T)
    return (terms @ fit).astype(np.float32)


def contacts(objects: Sequence[Track], hands: Hands, looks: int, ring_px: int, least: int) -> dict[Hand, np.ndarray]:
    """Side -> (looks,) index of the object that the hand touches, NOTHING where it touches none or is not in sight. What lasts for
    fewer than `least` looks in a row is no touch, unless the hand is not seen for longer."""
    return {side: _lasting([_touch(objects, hands[side].get(k), k, ring_px) for k in range(looks)], hands[side], least)
            for side in SIDES}  # fmt: skip


def _touch(objects: Sequence[Track], hand: np.ndarray | None, k: int, ring_px: int) -> int:
    if hand is None:
        return NOTHING
    ring = dilate(hand, ring_px)
    overlap = [int((ring & one.pieces[k].mask).sum()) if k in one.pieces else 0 for one in objects]
    return int(np.argmax(overlap)) if any(overlap) else NOTHING


def _lasting(said: list[int], seen: Mapping[int, np.ndarray], least: int) -> np.ndarray:
    out, k = np.array(said, np.int64), 0
    while k < len(said):
        end = next((j for j in range(k, len(said)) if said[j] != said[k]), len(said))
        alone = (k == 0 or k - 1 not in seen) and (end == len(said) or end not in seen)
        if end - k < least and not alone:
            out[k:end] = NOTHING
        k = end
    return out
