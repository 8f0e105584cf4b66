"""Labels follow optical flow from both bracketing key frames; where that is in doubt, patches of the key frames decide.

Every frame is solved by itself from its key frames, so that no error is handed on: only the flow that leads to a key frame
is built up frame by frame, each time started from the last one and fitted again to the two images.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from afford.backends.propagate import BACKGROUND, UNKNOWN, Propagated
from afford.optical_flow import flow_between, follow, identity_map
from afford.tracking.patches import REACH_PX, UNMATCHED, colours, match

BLUR = (5, 5)
"""window over which colour differences are averaged, px"""
DOUBT = 12.0
"""mean colour difference (sum over Lab) from which a pixel counts as not explained by flow"""
OUT_OF_VIEW = 10.0
"""by how much background is likelier where neither key frame has seen the place"""
SHARPNESS = 4.0
"""difference in matching cost that makes an entity e times likelier"""
SMOOTH_PX = 1.0


@dataclass(frozen=True)
class View:
    """A key frame as seen from another frame."""

    flow: np.ndarray
    """(h, w, 2) from the frame to the key frame, px"""
    labels: np.ndarray
    """(h, w) int16 of the key frame"""
    colours: np.ndarray
    """of the key frame, see `afford.tracking.patches.colours`"""
    nearness: float
    """1 at the key frame, 0 at the next one"""


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Any) -> Propagated:
    """See `Propagate`. Reads `params.search_px` and `params.band_px`."""
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    for at, views in _views(rgb, key_index, key_labels):
        labels[at], confidence[:, at] = _solve(colours(rgb[at]), views, count, params.search_px, params.band_px)
    return Propagated(labels, confidence)


def _views(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray) -> Iterator[tuple[int, list[View]]]:
    """Every frame that is no key frame, with the one or two key frames around it, earlier first."""
    keys = [int(at) for at in key_index]
    tones = [colours(rgb[at]) for at in keys]
    for left in range(-1, len(keys)):
        first = keys[left] if left >= 0 else -1
        last = keys[left + 1] if left + 1 < len(keys) else len(rgb)
        between = range(first + 1, last)
        both = left >= 0 and left + 1 < len(keys)
        found: dict[int, list[View]] = {at: [] for at in between}
        for k, order in ((left, between), (left + 1, between[::-1])):
            if 0 <= k < len(keys):
                for at, flow in _flows_to(rgb, keys[k], order):
                    nearness = 1 - abs(at - keys[k]) / (last - first) if both else 1.0
                    found[at].append(View(flow, key_labels[k], tones[k], nearness))
        yield from found.items()


def _flows_to(rgb: np.ndarray, key: int, order: range) -> Iterator[tuple[int, np.ndarray]]:
    """Flow (h, w, 2) float32 to the key frame from each frame of `order`, which leads away from it."""
    grey_key = last = cv2.cvtColor(rgb[key], cv2.COLOR_RGB2GRAY)
    flow = np.zeros((*last.shape, 2), np.float32)
    for at in order:
        grey = cv2.cvtColor(rgb[at], cv2.COLOR_RGB2GRAY)
        flow = flow_between(grey, grey_key, start=follow(flow_between(grey, last), flow))
        last = grey
        yield at, flow


def _solve(target: np.ndarray, views: list[View], count: int, search_px: int, band_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Labels (h, w) int16 of one frame and the confidence (n,) of each entity."""
    guess, doubt, unseen = _guess(target, views, band_px)
    where = np.argwhere(doubt)
    cost = np.full((len(where), count + 1), UNMATCHED, np.float32)
    cost[unseen[doubt], BACKGROUND] -= OUT_OF_VIEW
    for view in views:
        match(target, view.colours, view.labels, view.flow, where, search_px, cost)
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
    labels = cv2.remap(view.labels, at, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=BACKGROUND)
    shown = cv2.remap(view.colours[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX], at, None, cv2.INTER_LINEAR)
    difference = cv2.absdiff(shown, inner).sum(axis=2, dtype=np.float32)
    difference[outside] = 100
    return np.maximum(labels, BACKGROUND), cv2.blur(np.minimum(difference, 100), BLUR), outside


def _outlines(labels: np.ndarray, band_px: int) -> np.ndarray:
    """Pixels within `band_px` of a change of label, (h, w) bool."""
    change = np.zeros(labels.shape, np.uint8)
    change[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    change[1:] |= labels[1:] != labels[:-1]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band_px + 1, 2 * band_px + 1))
    return cv2.dilate(change, disc) > 0


def _belief(guess: np.ndarray, where: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Probability (l, h, w) float32 of every label: certain outside `where`, slightly smoothed over the image."""
    odds = np.exp((cost.min(axis=1, keepdims=True) - cost) / SHARPNESS)
    odds /= odds.sum(axis=1, keepdims=True)
    belief = (guess[None] == np.arange(cost.shape[1])[:, None, None]).astype(np.float32)
    belief[:, where[:, 0], where[:, 1]] = odds.T
    return np.stack([cv2.GaussianBlur(layer, (0, 0), SMOOTH_PX) for layer in belief])
