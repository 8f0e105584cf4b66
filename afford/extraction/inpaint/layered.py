"""Look behind the hands in other frames: the background by camera motion, each touched object by its own motion."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction.inpaint import Filled
from afford.extraction.inpaint.telea import spread
from afford.extraction.layers import regions
from afford.extraction.layers.background import BackgroundFill
from afford.extraction.layers.camera import register
from afford.extraction.layers.follow import follow
from afford.extraction.layers.gather import gather_colour
from afford.extraction.layers.relight import grip_shade, relight
from afford.extraction.layers.shape import as_cameras, complete_shape, on_canvas, recall
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

MOVING_PX = 3
RIM_PX = 4


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Background layer, then object layers over it, each relit to meet its surroundings, objects shaded by the grip."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    filled = fill_background(frames, grey, tracks, hole)
    for index in regions.touched_indices(tracks):
        _paint_object(filled, frames, grey, tracks, hole, index)
    return filled


def fill_background(frames: Frames, grey: np.ndarray, tracks: Tracks, hole: np.ndarray) -> Filled:
    """The hole as if it showed background only."""
    static = ~dilate(regions.hands(tracks) | regions.objects(tracks), MOVING_PX)
    usable = static & regions.told(tracks)[:, None, None]
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
    visible, hidden_by = tracks.masks[index], dilate(regions.others(tracks, index), 1)
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
