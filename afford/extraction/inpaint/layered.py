"""Look behind the hands in other frames: the background by camera motion, each touched object by its own motion."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction import layers
from afford.extraction.inpaint import Filled
from afford.extraction.layers.appearance import gather_colour, grip_shade, log_ratio, membrane, relight
from afford.extraction.layers.camera import Background, register
from afford.extraction.layers.follow import follow
from afford.extraction.layers.shape import as_cameras, complete_shape, on_canvas, recall
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

RADIUS_PX = 3


def telea(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Telea 2004, radius 3 px. Confidence is 0: everything is guessed."""
    rgb = np.stack([spread(image, mask) for image, mask in zip(frames.rgb, hole, strict=True)])
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(rgb, source, np.zeros(hole.shape, np.uint8))


def spread(image: np.ndarray, hole: np.ndarray) -> np.ndarray:
    """One (h, w, 3) uint8 image filled inside `hole` (h, w) bool; unchanged when the hole is empty."""
    return cv2.inpaint(image, hole.view(np.uint8), RADIUS_PX, cv2.INPAINT_TELEA) if hole.any() else image.copy()


def median(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Robust mean over registered frames; objects behind hands are not followed."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    return fill_background(frames, grey, tracks, hole)


LIT_QUANTILE = 0.7
"""of the frames that show a point, at least these many out of ten may show it in shadow: a bright one is taken for lit"""
NEAR, SPREAD = 8, 16
"""frames to look into: the nearest ones, and ones evenly spread over the group"""
FADE_FRAMES, FAR = 12.0, 0.05
"""how fast trust in a frame falls with its distance, and what is left of it far away"""
NOISE = 0.04
"""a smaller log ratio is no shadow"""
SHRINK = 4
"""light is soft: it is compared on images this many times smaller"""
SMOOTH_PX = 1.5
"""blur of the light (sigma, small pixels)"""


class BackgroundFill:
    """Looks up colours of the background that belong to a place, not to the light that fell on it when it was seen."""

    def __init__(self, rgb: np.ndarray, usable: np.ndarray, background: Background) -> None:
        """rgb: (t, h, w, 3) uint8. usable: (t, h, w) bool, pixels that show the background."""
        self.background, self.usable = background, usable
        self._small = np.stack([shrink(image.astype(np.float32)) for image in rgb])
        self._small_usable = np.stack([shrink(mask.astype(np.float32)) > 0.99 for mask in usable])
        self._even = np.stack([_even(image, *self._darkening(t)) for t, image in enumerate(rgb)])

    def colour(self, t: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colour (m, 3) float32 in even light of pixels (m, 2) x, y of frame `t`, and the weight (m,) of what shows it."""
        points = self.background.scene_points(t, pixels, self.usable.shape[1:])
        rows = self._sources(t)
        weights = FAR + np.exp(-np.abs(rows - t) / FADE_FRAMES)
        return gather_colour(points, self.background.cameras[rows], rows, weights, self._even, self.usable, 0.5)

    def _sources(self, t: int) -> np.ndarray:
        group = np.flatnonzero(self.background.group == self.background.group[t])
        group = group[group != t]
        near = group[np.argsort(np.abs(group - t), kind="stable")[:NEAR]]
        spread = group[np.unique(np.linspace(0, len(group) - 1, SPREAD).astype(int))] if len(group) else group
        return np.unique(np.concatenate([near, spread]))

    def _darkening(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Small (h, w) log ratio of the frame to its background in light, and how far it is known."""
        small = self._small[t]
        y, x = np.mgrid[0 : small.shape[0], 0 : small.shape[1]]
        at = np.stack([x.ravel(), y.ravel()], axis=1) * SHRINK + (SHRINK - 1) // 2
        points = self.background.scene_points(t, np.minimum(at, np.array(self.usable.shape[:0:-1]) - 1), self.usable.shape[1:])
        rows = self._sources(t)
        cameras = _to_small() @ self.background.cameras[rows]
        lit, found = gather_colour(points, cameras, rows, np.ones(len(rows)), self._small, self._small_usable, LIT_QUANTILE)
        known = (found > 2).reshape(x.shape) & self._small_usable[t]
        return log_ratio(small, lit.reshape(*x.shape, 3), known)


def shrink(image: np.ndarray) -> np.ndarray:
    """(h, w) or (h, w, 3) float32 averaged over blocks of SHRINK x SHRINK pixels."""
    size = (-(-image.shape[1] // SHRINK), -(-image.shape[0] // SHRINK))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _to_small() -> np.ndarray:
    shift = (1 / SHRINK - 1) / 2
    return np.array([[1 / SHRINK, 0, shift], [0, 1 / SHRINK, shift], [0, 0, 1]])


def _even(image: np.ndarray, darkening: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The frame (h, w, 3) uint8 with its shadows lifted where they are known."""
    if not known.any():
        return image
    surface = cv2.GaussianBlur(membrane(darkening, known), (0, 0), SMOOTH_PX)
    surface = np.sign(surface) * np.maximum(np.abs(surface) - NOISE, 0)
    gain = np.exp(-cv2.resize(surface, image.shape[1::-1], interpolation=cv2.INTER_LINEAR))[..., None]
    return np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)


MOVING_PX = 3
RIM_PX = 4


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Background layer, then object layers over it, each relit to meet its surroundings, objects shaded by the grip."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    filled = fill_background(frames, grey, tracks, hole)
    for index in layers.touched_indices(tracks):
        _paint_object(filled, frames, grey, tracks, hole, index)
    return filled


def fill_background(frames: Frames, grey: np.ndarray, tracks: Tracks, hole: np.ndarray) -> Filled:
    """The hole as if it showed background only."""
    static = ~dilate(layers.hands(tracks) | layers.objects(tracks), MOVING_PX)
    usable = static & layers.told(tracks)[:, None, None]
    behind = BackgroundFill(frames.rgb, usable, register(grey, frames.frame, static))
    filled = Filled(frames.rgb.copy(), np.zeros(hole.shape, np.uint8), np.zeros(hole.shape, np.uint8))
    for t in np.flatnonzero(hole.any(axis=(1, 2))).tolist():
        target = dilate(hole[t], RIM_PX + 2)
        pixels = _pixels(target)
        colour, found = behind.colour(t, pixels)
        fill = _spread_unseen(frames.rgb[t], pixels, colour, found, target)
        shown = _mask(target.shape, pixels, found > 0)
        fill = relight(fill, frames.rgb[t], target & ~hole[t] & usable[t] & shown)
        _put(filled, t, hole[t], fill, shown, found, pixels, PixelSource.BACKGROUND)
    return filled


def _paint_object(filled: Filled, frames: Frames, grey: np.ndarray, tracks: Tracks, hole: np.ndarray, index: int) -> None:
    visible, hidden_by = tracks.masks[index], dilate(layers.others(tracks, index), 1)
    path = follow(grey, visible, hidden_by)
    complete, _ = complete_shape(path, frames.frame, visible, hidden_by & ~visible)
    inner, cameras = erode(visible, 1), as_cameras(path.poses)
    for t in np.flatnonzero((complete & hole).any(axis=(1, 2))).tolist():
        target = dilate(complete[t] & hole[t], RIM_PX) & complete[t]
        pixels = _pixels(target)
        rows, weights = recall(path, frames.frame, t)
        colour, found = gather_colour(on_canvas(path.poses[t], pixels), cameras[rows], rows, weights, frames.rgb, inner, 0.5)
        shown = _mask(target.shape, pixels, found > 0)
        fill = _spread_unseen(frames.rgb[t], pixels, colour, found, target)
        fill = relight(fill, frames.rgb[t], shown & inner[t] & ~hole[t]) * grip_shade(hole[t])[..., None]
        _put(filled, t, complete[t] & hole[t], fill, shown, found, pixels, PixelSource.OBJECT)


def _put(filled: Filled, t: int, where: np.ndarray, fill: np.ndarray, shown: np.ndarray, found: np.ndarray, pixels: np.ndarray,
         source: PixelSource) -> None:
    trust = np.zeros(where.shape, np.float32)
    trust[pixels[:, 1], pixels[:, 0]] = 1 - np.exp(-found)
    filled.rgb[t][where] = np.clip(np.rint(fill[where]), 0, 255)
    filled.source[t][where] = np.where(shown[where], source, PixelSource.SPATIAL)
    filled.confidence[t][where] = np.where(shown, 255 * trust, 0)[where]


def _spread_unseen(
    image: np.ndarray, pixels: np.ndarray, colour: np.ndarray, found: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """(h, w, 3) float32: the gathered colours, and cv2.inpaint where no frame has seen the point."""
    fill = image.copy()
    fill[pixels[:, 1], pixels[:, 0]] = np.rint(colour)
    unseen = _mask(target.shape, pixels, found == 0)
    fill = spread(fill, unseen).astype(np.float32)
    seen = found > 0
    fill[pixels[seen, 1], pixels[seen, 0]] = colour[seen]
    return fill


def _pixels(mask: np.ndarray) -> np.ndarray:
    y, x = np.nonzero(mask)
    return np.stack([x, y], axis=1)


def _mask(shape: tuple[int, ...], pixels: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    mask = np.zeros(shape, bool)
    mask[pixels[chosen, 1], pixels[chosen, 0]] = True
    return mask
