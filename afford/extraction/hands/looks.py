"""Which frames of a clip are looked at for hands, and how pixels move from each of them to the next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.optical_flow import flow_between, identity_map
from afford.extraction.tracks.keys import runs
from schemas.video import Frames


@dataclass(frozen=True)
class Looks:
    """Frames that are looked at. Motion is known at half their size."""

    at: np.ndarray
    """(k,) positions in `Frames.frame`, ascending"""
    rgb: np.ndarray
    """(k, h, w, 3) uint8"""
    time_s: np.ndarray
    """(k,) seconds from the start of the video"""
    back: list[np.ndarray | None]
    """flow from each to the one before, px of the half size; None where no video joins the two"""
    forth: list[np.ndarray | None]
    """flow from each to the next"""

    @property
    def stretches(self) -> list[range]:
        """Looks that a video joins."""
        cuts = [k for k, flow in enumerate(self.back) if flow is None]
        return [range(a, b) for a, b in zip(cuts, [*cuts[1:], len(self.at)], strict=True)]

    def carried(self, image: np.ndarray, k: int, step: int) -> np.ndarray | None:
        """What look k - step shows, (h, w) float32, where it is in look k; `step` is 1 or -1. None where nothing joins the two."""
        flow = self.back[k] if step == 1 else self.forth[k]
        return None if flow is None else _pulled(image, flow)


def look(frames: Frames, every_s: float) -> Looks:
    """Frames about `every_s` apart, the first and the last of every unbroken stretch among them."""
    chosen = [spread(frames.time_ns[part] / 1e9, every_s) + part.start for part in runs(frames.frame, 1)]
    at = np.concatenate(chosen)
    grey = [cv2.cvtColor(_half(rgb), cv2.COLOR_RGB2GRAY) for rgb in frames.rgb[at]]
    starts = set(np.cumsum([0, *map(len, chosen)]).tolist())
    back, forth = list(_flows(grey, starts, -1)), list(_flows(grey, starts, 1))
    return Looks(at, frames.rgb[at], frames.time_ns[at] / 1e9, back, forth)


def spread(time_s: np.ndarray, every_s: float) -> np.ndarray:
    """Positions among times (n,), ascending, that are about `every_s` apart; the first and the last are among them."""
    count = max(round((time_s[-1] - time_s[0]) / every_s), 1) + 1
    wanted = np.linspace(time_s[0], time_s[-1], count)
    return np.unique(np.abs(time_s[:, None] - wanted).argmin(0))


def _half(rgb: np.ndarray) -> np.ndarray:
    return cv2.resize(rgb, (max(rgb.shape[1] // 2, 16), max(rgb.shape[0] // 2, 16)), interpolation=cv2.INTER_AREA)


def _flows(grey: list[np.ndarray], starts: set[int], step: int) -> Iterator[np.ndarray | None]:
    """Flow from every look to its neighbour `step` away; `starts` are the first looks of stretches, and the number of looks."""
    for k, image in enumerate(grey):
        apart = (k if step == -1 else k + 1) in starts
        yield None if apart else flow_between(image, grey[k + step], "fast")


def _pulled(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    scale = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
    where = identity_map(height, width) + cv2.resize(flow, (width, height)) * scale
    return cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
