"""Propagate labels by optical flow from both bracketing key frames; patch matching decides where flow is uncertain.

Every frame is solved directly from its key frames, so that label errors do not accumulate. Only the flow to a key frame is
composed frame by frame; each time it is refined against the two images.
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
from afford.extraction.tracks.match import REACH_PX, UNMATCHED, best_flow, coarse_to_fine_flow, padded_lab, patch_match

BLUR = (5, 5)
"""window over which colour differences are averaged, px"""
UNCERTAIN_DIFFERENCE = 30.0
"""mean colour difference (sum over Lab) from which flow does not explain a pixel"""
BORDER_BONUS = 10.0
"""lower cost of the label at the border of the key frame, for a pixel that lies outside every key frame"""
NEIGHBOUR_COST = 8.0
"""extra cost of a match in a solved neighbour; without it, entities persist after they left the image"""
SHARPNESS = 4.0
"""difference in matching cost that makes an entity e times more likely"""
SMOOTH_PX = 1.0
SPECK = 1e-3
"""smallest piece of an entity that enters or leaves, as a share of the image"""


@dataclass(frozen=True)
class View:
    """A key frame, or a solved neighbour, with the flow that leads to it."""

    flow: np.ndarray
    """(h, w, 2) from the frame to the key frame, px"""
    labels: np.ndarray
    """(h, w) int16 of the key frame"""
    lab: np.ndarray
    """colours of the key frame, see `afford.extraction.tracks.match.padded_lab`"""
    nearness: float
    """1 at the key frame, 0 at the next one"""
    extra_cost: float = 0.0
    """added to the cost of every match in this view"""


Key = tuple[int, np.ndarray]
"""position of a key frame and its labels (h, w) int16"""
Solved = tuple[np.ndarray, np.ndarray]
"""labels (h, w) int16 of a frame, confidence (n,) float32 of its entities"""


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Flow) -> Propagated:
    """Propagate by flow, see `Propagate`."""
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    keys: list[Key | None] = [None, *((int(at), painted) for at, painted in zip(key_index, key_labels, strict=True)), None]
    for pair in pairwise(keys):
        local = np.unique(np.concatenate([[BACKGROUND], *(_entity_labels(end[1]) for end in pair if end)]))
        before, after = (end and (end[0], _relabel(end[1], local)) for end in pair)
        for at, (found, certainty) in _segment(rgb, before, after, len(local) - 1, params).items():
            labels[at], confidence[local[1:] - 1, at] = local[found], certainty
    return Propagated(labels, confidence)


def _entity_labels(labels: np.ndarray) -> np.ndarray:
    """Ascending labels of the entities that a key frame shows."""
    found = np.unique(labels)
    return found[found > BACKGROUND].astype(np.int16)


def _relabel(labels: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Replace labels by their indices in `local`: few entities are visible at a time, and cost grows with their number."""
    names = np.full(max(int(local.max()), int(labels.max())) + 2, BACKGROUND, np.int16)
    names[local] = np.arange(len(local))
    names[UNKNOWN] = UNKNOWN
    return names[labels]


def _segment(rgb: np.ndarray, before: Key | None, after: Key | None, count: int, params: Flow) -> dict[int, Solved]:
    """Solve the frames between two key frames.

    An entity that only one key frame shows enters or leaves, often fast. Then the frames are solved in order, starting at that
    key frame, and each also matches patches in the frame solved before it. Entities that leave are solved in forward order,
    entities that enter in backward order; leaving entities are placed on the background of the backward solution.
    """
    views = _views(rgb, before, after)
    entering, leaving = _entering_and_leaving(before, after)
    order = sorted(views)
    if not entering and not leaving:
        return {at: _solve(padded_lab(rgb[at]), views[at], count, params) for at in order}
    found = _solve_sequentially(rgb, views, order[::-1] if entering else order, count, params)
    if entering and leaving:
        _add_leaving(found, _solve_sequentially(rgb, views, order, count, params), leaving)
    for labels, _ in found.values():
        for label in entering + leaving:
            _drop_specks(labels, label)
    return found


def _entering_and_leaving(before: Key | None, after: Key | None) -> tuple[list[int], list[int]]:
    """Labels that only the later, and labels that only the earlier key frame shows; both empty when a key frame is missing."""
    if before is None or after is None:
        return [], []
    early, late = _entity_labels(before[1]), _entity_labels(after[1])
    return np.setdiff1d(late, early).tolist(), np.setdiff1d(early, late).tolist()


def _add_leaving(found: dict[int, Solved], forward: dict[int, Solved], leaving: list[int]) -> None:
    """Copy leaving entities from the forward solution to the background of `found`, in place."""
    for at, (labels, certainty) in forward.items():
        mine = np.isin(labels, leaving) & (found[at][0] == BACKGROUND)
        found[at][0][mine] = labels[mine]
        index = np.array(leaving) - 1
        found[at][1][index] = certainty[index]


def _drop_specks(labels: np.ndarray, label: int) -> None:
    """Set small connected components of one entity to background, in place."""
    _, piece, stats, _ = cv2.connectedComponentsWithStats((labels == label).astype(np.uint8), connectivity=8)
    small = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < SPECK * labels.size)
    labels[np.isin(piece, small[small > 0])] = BACKGROUND


def _solve_sequentially(
    rgb: np.ndarray, views: dict[int, list[View]], order: list[int], count: int, params: Flow
) -> dict[int, Solved]:
    """Solve frames in order; each has the frame solved before it as a further view."""
    found: dict[int, Solved] = {}
    last: int | None = None
    for at in order:
        here, lab = list(views[at]), padded_lab(rgb[at])
        if last is not None:
            labels = found[last][0]
            flow = coarse_to_fine_flow(_grey(rgb[at]), _grey(rgb[last]), labels)
            here.append(View(flow, labels, padded_lab(rgb[last]), 0.0, NEIGHBOUR_COST))
        found[at] = _solve(lab, here, count, params)
        last = at
    return found


def _grey(rgb: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)


def _views(rgb: np.ndarray, before: Key | None, after: Key | None) -> dict[int, list[View]]:
    """Views of the bracketing key frames, earlier first, for every frame between two key frames or beyond the only one."""
    first, last = before[0] if before else -1, after[0] if after else len(rgb)
    between = range(first + 1, last)
    found: dict[int, list[View]] = {at: [] for at in between}
    for key, order in ((before, between), (after, between[::-1])):
        if key:
            lab = padded_lab(rgb[key[0]])
            for at, flow in _flows_to(rgb, key, order):
                nearness = 1 - abs(at - key[0]) / (last - first) if before and after else 1.0
                found[at].append(View(flow, key[1], lab, nearness))
    return found


def _flows_to(rgb: np.ndarray, key: Key, order: range) -> Iterator[tuple[int, np.ndarray]]:
    """Compose the flow (h, w, 2) float32 to the key frame from each frame of `order`, which starts next to the key frame."""
    grey_key = last = _grey(rgb[key[0]])
    flow = np.zeros((*last.shape, 2), np.float32)
    for at in order:
        grey = _grey(rgb[at])
        composed = compose_flow(coarse_to_fine_flow(grey, last, _warp_labels(key[1], flow)), flow)
        flow = best_flow(grey, grey_key, [composed, flow_between(grey, grey_key, start=composed)])
        last = grey
        yield at, flow


def _warp_labels(labels: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Warp labels (h, w) int16 of a key frame by flow; pixels from outside the image become background."""
    at = identity_map(*labels.shape) + flow
    found = cv2.remap(labels, at, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=BACKGROUND)
    return np.maximum(found, BACKGROUND)


def _solve(target: np.ndarray, views: list[View], count: int, params: Flow) -> Solved:
    """Compute labels (h, w) int16 of one frame, and the confidence (n,) of each entity: its mean posterior."""
    initial, uncertain, unseen = _initial_labels(target, views, params.band_px)
    where = np.argwhere(uncertain)
    cost = np.full((len(where), count + 1), UNMATCHED, np.float32)
    new = np.flatnonzero(unseen[uncertain])
    cost[new, _border_labels(views)[uncertain][new]] -= BORDER_BONUS
    for view in views:
        patch_match(target, view.lab, view.labels, view.flow, where, params.search_px, np.float32(view.extra_cost), cost)
    posterior = _posterior(initial, where, cost)
    labels = np.where(uncertain, posterior.argmax(axis=0), initial).astype(np.int16)
    own = np.take_along_axis(posterior, labels[None].astype(np.int64), axis=0)[0]
    size = np.bincount(labels.ravel(), minlength=count + 1)
    confidence = np.bincount(labels.ravel(), own.ravel(), minlength=count + 1) / np.maximum(size, 1)
    return labels, confidence[1:].astype(np.float32)


def _initial_labels(target: np.ndarray, views: list[View], band_px: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels (h, w) by flow alone, where they are uncertain, and which pixels lie outside every key frame, both (h, w) bool."""
    inner = target[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX]
    best = np.full(inner.shape[:2], -1, np.float32)
    initial, least = np.zeros(inner.shape[:2], np.int16), np.full(inner.shape[:2], 1e3, np.float32)
    uncertain, unseen = np.zeros(inner.shape[:2], bool), np.ones(inner.shape[:2], bool)
    for n, view in enumerate(views):
        labels, difference, outside = _warp_view(inner, view)
        uncertain |= _outline_band(labels, band_px) | ((labels != initial) if n else False)
        weight = np.exp(-difference / 8) * view.nearness
        initial, best = np.where(weight > best, labels, initial), np.maximum(weight, best)
        least, unseen = np.minimum(least, difference), unseen & outside
    return initial, uncertain | (least > UNCERTAIN_DIFFERENCE), unseen


def _warp_view(inner: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Warp a view by its flow: labels, mean colour difference, and which pixels come from outside the image."""
    height, width = inner.shape[:2]
    at = identity_map(height, width) + view.flow
    outside = (at[..., 0] < 0) | (at[..., 1] < 0) | (at[..., 0] > width - 1) | (at[..., 1] > height - 1)
    shown = cv2.remap(view.lab[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX], at, None, cv2.INTER_LINEAR)
    difference = cv2.absdiff(shown, inner).sum(axis=2, dtype=np.float32)
    difference[outside] = 100
    return _warp_labels(view.labels, view.flow), cv2.blur(np.minimum(difference, 100), BLUR), outside


def _border_labels(views: list[View]) -> np.ndarray:
    """Labels (h, w) int16 of the nearest key frame, with its border repeated outwards."""
    view = max(views, key=lambda one: one.nearness)
    height, width = view.labels.shape
    at = (identity_map(height, width) + view.flow).clip(0, (width - 1, height - 1))
    return np.maximum(cv2.remap(view.labels, at.astype(np.float32), None, cv2.INTER_NEAREST), BACKGROUND)


def _outline_band(labels: np.ndarray, band_px: int) -> np.ndarray:
    """Mask of the pixels within `band_px` of a change of label, (h, w) bool."""
    change = np.zeros(labels.shape, bool)
    change[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    change[1:] |= labels[1:] != labels[:-1]
    return dilate(change, band_px)


def _posterior(initial: np.ndarray, where: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Posterior probability (l, h, w) float32 of every label: certain outside `where`, slightly smoothed over the image."""
    odds = np.exp((cost.min(axis=1, keepdims=True) - cost) / SHARPNESS)
    odds /= odds.sum(axis=1, keepdims=True)
    posterior = (initial[None] == np.arange(cost.shape[1])[:, None, None]).astype(np.float32)
    posterior[:, where[:, 0], where[:, 1]] = odds.T
    return np.stack([cv2.GaussianBlur(layer, (0, 0), SMOOTH_PX) for layer in posterior])
