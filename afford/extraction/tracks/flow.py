"""Labels follow optical flow from both bracketing key frames; where that is in doubt, patches of the key frames decide.

Every frame is solved by itself from its key frames, so that no error is handed on: only the flow that leads to a key frame
is built up frame by frame, each time started from the last one and fitted again to the two images.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.common.optical_flow import compose_flow, flow_between, identity_map
from afford.extraction.tracks import BACKGROUND, UNKNOWN, Flow, Propagated
from afford.extraction.tracks.match import REACH_PX, UNMATCHED, better_of, colours, match, step_between

BLUR = (5, 5)
"""window over which colour differences are averaged, px"""
DOUBT = 30.0
"""mean colour difference (sum over Lab) from which a pixel counts as not explained by flow"""
OUT_OF_VIEW = 10.0
"""by how much that is likelier which stood at the border of the key frame, where neither key frame has seen the place"""
HANDED_ON = 8.0
"""cost of trusting a solved neighbour rather than a key frame; without it, what has left the image lives on"""
SHARPNESS = 4.0
"""difference in matching cost that makes an entity e times likelier"""
SMOOTH_PX = 1.0
SPECK = 1e-3
"""pieces of an entity that enters or leaves are dropped when they cover less than this share of the image"""


@dataclass(frozen=True)
class View:
    """A key frame, or a solved neighbour, as seen from another frame."""

    flow: np.ndarray
    """(h, w, 2) from the frame to the key frame, px"""
    labels: np.ndarray
    """(h, w) int16 of the key frame"""
    colours: np.ndarray
    """of the key frame, see `afford.extraction.tracks.match.colours`"""
    nearness: float
    """1 at the key frame, 0 at the next one"""
    doubt: float = 0.0
    """added to the cost of what is found here"""


Key = tuple[int, np.ndarray]
"""position of a key frame and its labels (h, w) int16"""
Solved = tuple[np.ndarray, np.ndarray]
"""labels (h, w) int16 of a frame, confidence (n,) float32 of its entities"""


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Flow) -> Propagated:
    """See `Propagate`."""
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    keys: list[Key | None] = [None, *((int(at), painted) for at, painted in zip(key_index, key_labels, strict=True)), None]
    for pair in pairwise(keys):
        local = np.unique(np.concatenate([[BACKGROUND], *(_shown(end[1]) for end in pair if end)]))
        before, after = (end and (end[0], _rename(end[1], local)) for end in pair)
        for at, (found, trust) in _segment(rgb, before, after, len(local) - 1, params).items():
            labels[at], confidence[local[1:] - 1, at] = local[found], trust
    return Propagated(labels, confidence)


def _shown(labels: np.ndarray) -> np.ndarray:
    """Labels of the entities of a key frame, ascending."""
    found = np.unique(labels)
    return found[found > BACKGROUND].astype(np.int16)


def _rename(labels: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Labels as indices into `local`: few entities are near at a time, and cost grows with their number."""
    names = np.full(max(int(local.max()), int(labels.max())) + 2, BACKGROUND, np.int16)
    names[local] = np.arange(len(local))
    names[UNKNOWN] = UNKNOWN
    return names[labels]


def _segment(rgb: np.ndarray, before: Key | None, after: Key | None, count: int, params: Flow) -> dict[int, Solved]:
    """Labels and confidences of the frames between two key frames.

    What only one of them shows enters or leaves, often fast: then the frames are solved in order, away from that key frame,
    and each also looks at the one just solved. Background of the one order gives way to what leaves in the other.
    """
    views = _views(rgb, before, after)
    entering, leaving = _changes(before, after)
    order = sorted(views)
    if not entering and not leaving:
        return {at: _solve(colours(rgb[at]), views[at], count, params) for at in order}
    found = _in_order(rgb, views, order[::-1] if entering else order, count, params)
    if entering and leaving:
        _add_leaving(found, _in_order(rgb, views, order, count, params), leaving)
    for labels, _ in found.values():
        for label in entering + leaving:
            _drop_specks(labels, label)
    return found


def _changes(before: Key | None, after: Key | None) -> tuple[list[int], list[int]]:
    """Labels that only the later, and that only the earlier of two key frames shows; none when one of them is missing."""
    if before is None or after is None:
        return [], []
    early, late = _shown(before[1]), _shown(after[1])
    return np.setdiff1d(late, early).tolist(), np.setdiff1d(early, late).tolist()


def _add_leaving(found: dict[int, Solved], forward: dict[int, Solved], leaving: list[int]) -> None:
    """Put what leaves, as the forward order has it, on the background of `found`, in place."""
    for at, (labels, trust) in forward.items():
        mine = np.isin(labels, leaving) & (found[at][0] == BACKGROUND)
        found[at][0][mine] = labels[mine]
        index = np.array(leaving) - 1
        found[at][1][index] = trust[index]


def _drop_specks(labels: np.ndarray, label: int) -> None:
    """Turn every small piece of one entity into background, in place."""
    _, piece, stats, _ = cv2.connectedComponentsWithStats((labels == label).astype(np.uint8), connectivity=8)
    small = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < SPECK * labels.size)
    labels[np.isin(piece, small[small > 0])] = BACKGROUND


def _in_order(rgb: np.ndarray, views: dict[int, list[View]], order: list[int], count: int, params: Flow) -> dict[int, Solved]:
    """Solve frames one after the other; each has the one before as a further view."""
    found: dict[int, Solved] = {}
    last: int | None = None
    for at in order:
        here, tone = list(views[at]), colours(rgb[at])
        if last is not None:
            labels = found[last][0]
            step = step_between(_grey(rgb[at]), _grey(rgb[last]), labels)
            here.append(View(step, labels, colours(rgb[last]), 0.0, HANDED_ON))
        found[at] = _solve(tone, here, count, params)
        last = at
    return found


def _grey(rgb: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)


def _views(rgb: np.ndarray, before: Key | None, after: Key | None) -> dict[int, list[View]]:
    """Every frame between two key frames (or beyond the only one) with the key frames around it, earlier first."""
    first, last = before[0] if before else -1, after[0] if after else len(rgb)
    between = range(first + 1, last)
    found: dict[int, list[View]] = {at: [] for at in between}
    for key, order in ((before, between), (after, between[::-1])):
        if key:
            tone = colours(rgb[key[0]])
            for at, flow in _flows_to(rgb, key, order):
                nearness = 1 - abs(at - key[0]) / (last - first) if before and after else 1.0
                found[at].append(View(flow, key[1], tone, nearness))
    return found


def _flows_to(rgb: np.ndarray, key: Key, order: range) -> Iterator[tuple[int, np.ndarray]]:
    """Flow (h, w, 2) float32 to the key frame from each frame of `order`, which leads away from it."""
    grey_key = last = _grey(rgb[key[0]])
    flow = np.zeros((*last.shape, 2), np.float32)
    for at in order:
        grey = _grey(rgb[at])
        followed = compose_flow(step_between(grey, last, _carried(key[1], flow)), flow)
        flow = better_of(grey, grey_key, [followed, flow_between(grey, grey_key, start=followed)])
        last = grey
        yield at, flow


def _carried(labels: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Labels (h, w) int16 that flow brings from a key frame, background from outside the image."""
    at = identity_map(*labels.shape) + flow
    found = cv2.remap(labels, at, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=BACKGROUND)
    return np.maximum(found, BACKGROUND)


def _solve(target: np.ndarray, views: list[View], count: int, params: Flow) -> Solved:
    """Labels (h, w) int16 of one frame and the confidence (n,) of each entity."""
    guess, doubt, unseen = _guess(target, views, params.band_px)
    where = np.argwhere(doubt)
    cost = np.full((len(where), count + 1), UNMATCHED, np.float32)
    new = np.flatnonzero(unseen[doubt])
    cost[new, _at_border(views)[doubt][new]] -= OUT_OF_VIEW
    for view in views:
        match(target, view.colours, view.labels, view.flow, where, params.search_px, np.float32(view.doubt), cost)
    belief = _belief(guess, where, cost)
    labels = np.where(doubt, belief.argmax(axis=0), guess).astype(np.int16)
    own = np.take_along_axis(belief, labels[None].astype(np.int64), axis=0)[0]
    size = np.bincount(labels.ravel(), minlength=count + 1)
    trust = np.bincount(labels.ravel(), own.ravel(), minlength=count + 1) / np.maximum(size, 1)
    return labels, trust[1:].astype(np.float32)


def _guess(target: np.ndarray, views: list[View], band_px: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What flow alone says: labels (h, w), where they are in doubt, and what lies outside every key frame, (h, w) bool."""
    inner = target[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX]
    best = np.full(inner.shape[:2], -1, np.float32)
    guess, least = np.zeros(inner.shape[:2], np.int16), np.full(inner.shape[:2], 1e3, np.float32)
    doubt, unseen = np.zeros(inner.shape[:2], bool), np.ones(inner.shape[:2], bool)
    for n, view in enumerate(views):
        labels, difference, outside = _look_up(inner, view)
        doubt |= _outlines(labels, band_px) | ((labels != guess) if n else False)
        weight = np.exp(-difference / 8) * view.nearness
        guess, best = np.where(weight > best, labels, guess), np.maximum(weight, best)
        least, unseen = np.minimum(least, difference), unseen & outside
    return guess, doubt | (least > DOUBT), unseen


def _look_up(inner: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels that flow brings from a key frame, mean colour difference, and what it brings from outside the image."""
    height, width = inner.shape[:2]
    at = identity_map(height, width) + view.flow
    outside = (at[..., 0] < 0) | (at[..., 1] < 0) | (at[..., 0] > width - 1) | (at[..., 1] > height - 1)
    shown = cv2.remap(view.colours[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX], at, None, cv2.INTER_LINEAR)
    difference = cv2.absdiff(shown, inner).sum(axis=2, dtype=np.float32)
    difference[outside] = 100
    return _carried(view.labels, view.flow), cv2.blur(np.minimum(difference, 100), BLUR), outside


def _at_border(views: list[View]) -> np.ndarray:
    """Labels (h, w) int16 of the nearest key frame; what lies outside it is taken to go on as it is at its border."""
    view = max(views, key=lambda one: one.nearness)
    height, width = view.labels.shape
    at = (identity_map(height, width) + view.flow).clip(0, (width - 1, height - 1))
    return np.maximum(cv2.remap(view.labels, at.astype(np.float32), None, cv2.INTER_NEAREST), BACKGROUND)


def _outlines(labels: np.ndarray, band_px: int) -> np.ndarray:
    """Pixels within `band_px` of a change of label, (h, w) bool."""
    change = np.zeros(labels.shape, bool)
    change[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    change[1:] |= labels[1:] != labels[:-1]
    return dilate(change, band_px)


def _belief(guess: np.ndarray, where: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Probability (l, h, w) float32 of every label: certain outside `where`, slightly smoothed over the image."""
    odds = np.exp((cost.min(axis=1, keepdims=True) - cost) / SHARPNESS)
    odds /= odds.sum(axis=1, keepdims=True)
    belief = (guess[None] == np.arange(cost.shape[1])[:, None, None]).astype(np.float32)
    belief[:, where[:, 0], where[:, 1]] = odds.T
    return np.stack([cv2.GaussianBlur(layer, (0, 0), SMOOTH_PX) for layer in belief])
