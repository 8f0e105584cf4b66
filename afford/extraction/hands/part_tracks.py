"""Parts of single looks that are the same thing over time: followed by motion, over short gaps as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.common.masks import iou
from afford.extraction.hands.motion import Looks

GROWN = 0.2
"""of the larger one's size, that the smaller of two looks of the same thing has"""
COVERED, ALIKE = 0.6, 0.5
"""of two things by one part, for them to have met there; of the larger one's size, that the smaller one has then"""


@dataclass(frozen=True)
class Piece:
    """One part of one look."""

    mask: np.ndarray
    """(h, w) bool"""
    lean: float = 0.0
    """hands: from -1, surely right, to 1, surely left"""
    mass: float = 0.0
    """hands: how much of a hand it is: what its pixels are surer of than one half, summed, rest counting less than motion"""
    seen: bool = True
    """False where motion alone says so"""


@dataclass
class Track:
    """A thing over time."""

    pieces: dict[int, Piece] = field(default_factory=dict)
    """look -> what is seen of it"""

    @property
    def times_seen(self) -> int:
        return sum(piece.seen for piece in self.pieces.values())

    @property
    def mass(self) -> float:
        """How much of a hand it is, all its life."""
        return sum(piece.mass for piece in self.pieces.values())

    @property
    def largest_px(self) -> int:
        return max(int(piece.mask.sum()) for piece in self.pieces.values())


def follow(found: Sequence[Sequence[Piece]], looks: Looks, min_iou: float, gap: int, rests: bool = False,
           leap_px: float = 0.0) -> list[Track]:  # fmt: skip
    """Tracks through the parts of every look. A part continues the track that overlaps it most, by `min_iou`, after motion; a track
    that finds none is carried on for up to `gap` looks, and ends where it was last seen, or (`rests`) with these looks.

    leap_px: things that are quicker than motion can be followed, as hands are: what is of like size within this distance is the
    same, and where two meet in one part each keeps the share that is nearer to it. 0: neither.
    """
    done: list[Track] = []
    for stretch in looks.stretches:
        live: list[Track] = []
        for k in stretch:
            waiting = [track for track in live if k - _last_seen(track) <= gap + 1]
            _carry(waiting, looks, k)
            parts = _shared(waiting, found[k], k) if leap_px else found[k]
            new = [Track({k: piece}) for piece in _unclaimed(waiting, parts, k, min_iou, leap_px)]
            done += new
            live = [track for track in (*waiting, *new) if k in track.pieces]
    return done if rests else [_trimmed(track) for track in done]


def _last_seen(track: Track) -> int:
    return max(k for k, piece in track.pieces.items() if piece.seen)


def _carry(tracks: Sequence[Track], looks: Looks, k: int) -> None:
    """Every track to look k by motion; one that leaves the picture ends."""
    for track in tracks:
        last = track.pieces[k - 1]
        moved = looks.carried(last.mask.astype(np.float32), k, 1)
        if moved is not None and (moved > 0.5).any():
            track.pieces[k] = Piece(moved > 0.5, seen=False)


def _unclaimed(tracks: Sequence[Track], found: Sequence[Piece], k: int, min_iou: float, leap_px: float) -> list[Piece]:
    """Hands the parts of look k to the tracks that lie there; gives those that no track claims."""
    here = [track for track in tracks if k in track.pieces]
    likeness = np.array([[_likeness(track.pieces[k].mask, piece.mask, min_iou, leap_px) for piece in found] for track in here])
    likeness = likeness.reshape(len(here), len(found))
    claimed = set()
    for i, j in zip(*linear_sum_assignment(-likeness), strict=True):
        if likeness[i, j] > 0:
            here[i].pieces[k] = found[j]
            claimed.add(j)
    return [piece for j, piece in enumerate(found) if j not in claimed]


def _likeness(here: np.ndarray, part: np.ndarray, min_iou: float, leap_px: float) -> float:
    """1 and more for what overlaps enough; below, how near what is of like size lies; 0 for what is another thing."""
    overlap = iou(here, part)
    if overlap >= min_iou or not leap_px:
        return 1 + overlap if overlap >= min_iou else 0.0
    sizes = sorted((int(here.sum()), int(part.sum())))
    apart_px = np.hypot(*(_middle(here) - _middle(part)))
    return max(0.0, 1 - float(apart_px) / leap_px) if sizes[0] >= GROWN * sizes[1] else 0.0


def _middle(mask: np.ndarray) -> np.ndarray:
    return np.array([at.mean() for at in np.nonzero(mask)])


def _shared(tracks: Sequence[Track], found: Sequence[Piece], k: int) -> list[Piece]:
    """The parts of look k; one in which two things of like size have met is parted between them and says nothing of sides."""
    out = list[Piece]()
    for piece in found:
        inside = [one for track in tracks if k in track.pieces and _within(one := track.pieces[k].mask, piece.mask)]
        sizes = sorted(int(one.sum()) for one in inside)
        if len(inside) != 2 or sizes[0] < ALIKE * sizes[1]:
            out.append(piece)
            continue
        away = [cv2.distanceTransform((~one).astype(np.uint8), cv2.DIST_L2, 3) for one in inside]
        halves = (piece.mask & (away[0] <= away[1]), piece.mask & (away[0] > away[1]))
        out += [replace(piece, mask=half, lean=0.0, mass=piece.mass * half.sum() / piece.mask.sum()) for half in halves]
    return out


def _within(one: np.ndarray, part: np.ndarray) -> bool:
    return bool(one.any() and (one & part).sum() >= COVERED * one.sum())


def _trimmed(track: Track) -> Track:
    last = _last_seen(track)
    return Track({k: piece for k, piece in track.pieces.items() if k <= last})
