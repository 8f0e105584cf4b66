"""What hands touch: what the finder takes for it, and what moves as the hand does while the background does not, now or soon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.hands.motion import Looks, moves_along, remembered
from afford.extraction.hands.part_tracks import Piece, Track
from afford.extraction.hands.refine import outlined, pieces
from schemas.video import SIDES, Hand

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
    motion: float
    """of motion, against 1 for what the finder says, in log odds"""
    sleeve: float
    """against a thing where a sleeve is sure, in log odds"""
    lasting: float
    """of what is known from one look to the next"""


def held(seen: np.ndarray, cloth: np.ndarray, looks: Looks, hands: Hands, reach: Reach) -> list[list[Piece]]:
    """The parts of every look that are objects beside a hand. seen, cloth: (k, h, w) probability of a touched object, and of a
    sleeve, which goes along with the hand as a thing does.
    """
    mine = [[hands[side][k] for side in SIDES if k in hands[side]] for k in range(len(looks.at))]
    own = [_evidence(seen[k], cloth[k], looks, k, mine[k], reach) for k in range(len(looks.at))]
    odds = remembered(own, looks, reach.lasting)
    return [_held(odds[k], seen[k], looks.rgb[k], np.any(mine[k], axis=0), reach) if mine[k] else [] for k in range(len(looks.at))]


def _evidence(
    p: np.ndarray, cloth: np.ndarray, looks: Looks, k: int, hands: Sequence[np.ndarray], reach: Reach,
) -> np.ndarray:
    """(h, w) log odds of a held object by what the finder says of look k and how things move in it."""
    if not hands:
        return np.zeros(p.shape, np.float32)
    hand, sure = np.any(hands, axis=0), np.clip(p.astype(np.float32), DOUBT, 1 - DOUBT)
    along = [moves_along(looks, k, one, hand, reach.far_px) for one in hands]
    return np.log(sure / (1 - sure)) + reach.motion * np.sum(along, axis=0) - reach.sleeve * cloth.astype(np.float32)


def _held(odds: np.ndarray, p: np.ndarray, rgb: np.ndarray, hand: np.ndarray, reach: Reach) -> list[Piece]:
    far = cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3) > reach.far_px
    thing, near = outlined(odds, rgb, hand | far), dilate(hand, reach.ring_px)
    found = [part for part in pieces(thing, reach.least_px, HALO_PX) if (part & near).any()]
    return [Piece(part) for part in found if not _cut_off(part) or p[part].mean() > 0.5]


def _cut_off(part: np.ndarray) -> bool:
    """Whether a part goes on outside the picture. What moves along with a hand and does is its sleeve, as a rule."""
    return bool(part[0].any() or part[-1].any() or part[:, 0].any() or part[:, -1].any())


def contacts(objects: Sequence[Track], hands: Hands, looks: int, ring_px: int, least: int) -> dict[Hand, np.ndarray]:
    """Side -> (looks,) index of the object that the hand touches, NOTHING where it touches none or is not in sight. What lasts for
    fewer than `least` looks in a row is no touch, unless the hand is not seen for longer.
    """
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
