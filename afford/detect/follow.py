"""Parts of single looks that are the same thing over time: followed by motion, over short gaps as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.detect.looks import Looks
from afford.metrics.masks import iou


@dataclass(frozen=True)
class Piece:
    """One part of one look."""

    mask: np.ndarray
    """(h, w) bool"""
    lean: float = 0.0
    """hands: from -1, surely right, to 1, surely left"""
    mass: float = 0.0
    """hands: how much of a hand it is: what its pixels are surer of than one half, summed"""
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


def follow(found: Sequence[Sequence[Piece]], looks: Looks, min_iou: float, gap: int, rests: bool = False) -> list[Track]:
    """Tracks through the parts of every look. A part continues the track that overlaps it most, by `min_iou`, after motion; a track
    that finds none is carried on for up to `gap` looks, and ends where it was last seen, or (`rests`) with these looks."""
    done: list[Track] = []
    for stretch in looks.stretches:
        live: list[Track] = []
        for k in stretch:
            waiting = [track for track in live if k - _last_seen(track) <= gap + 1]
            _carry(waiting, looks, k)
            new = [Track({k: piece}) for piece in _unclaimed(waiting, found[k], k, min_iou)]
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


def _unclaimed(tracks: Sequence[Track], found: Sequence[Piece], k: int, min_iou: float) -> list[Piece]:
    """Hands the parts of look k to the tracks that lie there; gives those that no track claims."""
    here = [track for track in tracks if k in track.pieces]
    overlap = np.array([[iou(track.pieces[k].mask, piece.mask) for piece in found] for track in here])
    overlap = overlap.reshape(len(here), len(found))
    claimed = set()
    for i, j in zip(*linear_sum_assignment(-overlap), strict=True):
        if overlap[i, j] >= min_iou:
            here[i].pieces[k] = found[j]
            claimed.add(j)
    return [piece for j, piece in enumerate(found) if j not in claimed]


def _trimmed(track: Track) -> Track:
    last = _last_seen(track)
    return Track({k: piece for k, piece in track.pieces.items() if k <= last})
