"""Inpaint without weights: `layered` looks behind the hands in other frames; `median` and `telea` are the baselines.

`layered` registers the background by camera motion and tracks each touched object by its own motion.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction import layers
from afford.extraction.inpaint import Filled
from afford.extraction.layers.appearance import contact_shadow, gather_colour, harmonic_fill, log_ratio, relight
from afford.extraction.layers.camera import Background, register
from afford.extraction.layers.shape import as_cameras, complete_shape, on_canvas, source_frames
from afford.extraction.layers.template import track_template
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

RADIUS_PX = 3


def telea(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Inpaint each frame alone (Telea 2004, radius 3 px). Confidence is 0: no pixel was observed."""
    rgb = np.stack([telea_image(image, mask) for image, mask in zip(frames.rgb, hole, strict=True)])
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(rgb, source, np.zeros(hole.shape, np.uint8))


def telea_image(image: np.ndarray, hole: np.ndarray) -> np.ndarray:
    """Fill one (h, w, 3) uint8 image inside `hole` (h, w) bool; an empty hole returns a copy."""
    return cv2.inpaint(image, hole.view(np.uint8), RADIUS_PX, cv2.INPAINT_TELEA) if hole.any() else image.copy()


def median(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Fill by a robust mean over registered frames; objects behind hands are not tracked."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    return fill_background(frames, grey, tracks, hole)


LIT_QUANTILE = 0.7
"""quantile of brightness over frames that counts as lit: up to this share of the frames may show a point in shadow"""
NEAR, SPACED = 8, 16
"""source frames: the nearest ones, and ones evenly spaced over the group"""
FADE_FRAMES, FAR = 12.0, 0.05
"""decay of the weight of a frame with its distance, and its weight far away"""
NOISE = 0.04
"""smaller log ratios do not count as shadow"""
SHRINK = 4
"""downscaling factor of the images on which shadows are estimated, because they are soft"""
SMOOTH_PX = 1.5
"""blur of the shadows (sigma, small pixels)"""


class BackgroundLookup:
    """Look up background colours with the shadows of each source frame removed."""

    def __init__(self, rgb: np.ndarray, usable: np.ndarray, background: Background) -> None:
        """rgb: (t, h, w, 3) uint8. usable: (t, h, w) bool, pixels that show the background."""
        self.background, self.usable = background, usable
        self._small = np.stack([shrink(image.astype(np.float32)) for image in rgb])
        self._small_usable = np.stack([shrink(mask.astype(np.float32)) > 0.99 for mask in usable])
        self._even = np.stack([_remove_shadows(image, *self._darkening(t)) for t, image in enumerate(rgb)])

    def colour(self, t: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colour (m, 3) float32 without shadows of pixels (m, 2) x, y of frame `t`, and the weight (m,) of its samples."""
        points = self.background.scene_points(t, pixels, self.usable.shape[1:])
        rows = self._sources(t)
        weights = FAR + np.exp(-np.abs(rows - t) / FADE_FRAMES)
        return gather_colour(points, self.background.cameras[rows], rows, weights, self._even, self.usable, 0.5)

    def _sources(self, t: int) -> np.ndarray:
        group = np.flatnonzero(self.background.group == self.background.group[t])
        group = group[group != t]
        near = group[np.argsort(np.abs(group - t), kind="stable")[:NEAR]]
        spaced = group[np.unique(np.linspace(0, len(group) - 1, SPACED).astype(int))] if len(group) else group
        return np.unique(np.concatenate([near, spaced]))

    def _darkening(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Log ratio (h, w) of the downscaled frame to the lit background, and its weight."""
        small = self._small[t]
        y, x = np.mgrid[0 : small.shape[0], 0 : small.shape[1]]
        at = np.stack([x.ravel(), y.ravel()], axis=1) * SHRINK + (SHRINK - 1) // 2
        points = self.background.scene_points(t, np.minimum(at, np.array(self.usable.shape[:0:-1]) - 1), self.usable.shape[1:])
        rows = self._sources(t)
        cameras = _shrink_matrix() @ self.background.cameras[rows]
        lit, found = gather_colour(points, cameras, rows, np.ones(len(rows)), self._small, self._small_usable, LIT_QUANTILE)
        known = (found > 2).reshape(x.shape) & self._small_usable[t]
        return log_ratio(small, lit.reshape(*x.shape, 3), known)


def shrink(image: np.ndarray) -> np.ndarray:
    """Average an image (h, w) or (h, w, 3) float32 over blocks of SHRINK x SHRINK pixels."""
    size = (-(-image.shape[1] // SHRINK), -(-image.shape[0] // SHRINK))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _shrink_matrix() -> np.ndarray:
    shift = (1 / SHRINK - 1) / 2
    return np.array([[1 / SHRINK, 0, shift], [0, 1 / SHRINK, shift], [0, 0, 1]])


def _remove_shadows(image: np.ndarray, darkening: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Brighten the shadows of a frame (h, w, 3) uint8 where they are known."""
    if not known.any():
        return image
    surface = cv2.GaussianBlur(harmonic_fill(darkening, known), (0, 0), SMOOTH_PX)
    surface = np.sign(surface) * np.maximum(np.abs(surface) - NOISE, 0)
    gain = np.exp(-cv2.resize(surface, image.shape[1::-1], interpolation=cv2.INTER_LINEAR))[..., None]
    return np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)


MOVING_PX = 3
RIM_PX = 4


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Fill by layers: background, then touched objects over it, each relit to match its surroundings.

    Objects also get a contact shadow.
    """
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    filled = fill_background(frames, grey, tracks, hole)
    for index in layers.touched_indices(tracks):
        _paint_object(filled, frames, grey, tracks, hole, index)
    return filled


def fill_background(frames: Frames, grey: np.ndarray, tracks: Tracks, hole: np.ndarray) -> Filled:
    """Fill the hole with background only."""
    static = ~dilate(layers.hands(tracks) | layers.objects(tracks), MOVING_PX)
    usable = static & layers.annotated_frames(tracks)[:, None, None]
    behind = BackgroundLookup(frames.rgb, usable, register(grey, frames.frame, static))
    filled = Filled(frames.rgb.copy(), np.zeros(hole.shape, np.uint8), np.zeros(hole.shape, np.uint8))
    for t in np.flatnonzero(hole.any(axis=(1, 2))).tolist():
        target = dilate(hole[t], RIM_PX + 2)
        pixels = _pixels(target)
        colour, found = behind.colour(t, pixels)
        fill = _fill_unseen(frames.rgb[t], pixels, colour, found, target)
        shown = _mask(target.shape, pixels, found > 0)
        fill = relight(fill, frames.rgb[t], target & ~hole[t] & usable[t] & shown)
        _write_fill(filled, t, hole[t], fill, shown, found, pixels, PixelSource.BACKGROUND)
    return filled


def _paint_object(filled: Filled, frames: Frames, grey: np.ndarray, tracks: Tracks, hole: np.ndarray, index: int) -> None:
    visible, hidden_by = tracks.masks[index], dilate(layers.others(tracks, index), 1)
    path = track_template(grey, visible, hidden_by)
    complete, _ = complete_shape(path, frames.frame, visible, hidden_by & ~visible)
    inner, cameras = erode(visible, 1), as_cameras(path.poses)
    for t in np.flatnonzero((complete & hole).any(axis=(1, 2))).tolist():
        target = dilate(complete[t] & hole[t], RIM_PX) & complete[t]
        pixels = _pixels(target)
        rows, weights = source_frames(path, frames.frame, t)
        colour, found = gather_colour(on_canvas(path.poses[t], pixels), cameras[rows], rows, weights, frames.rgb, inner, 0.5)
        shown = _mask(target.shape, pixels, found > 0)
        fill = _fill_unseen(frames.rgb[t], pixels, colour, found, target)
        fill = relight(fill, frames.rgb[t], shown & inner[t] & ~hole[t]) * contact_shadow(hole[t])[..., None]
        _write_fill(filled, t, complete[t] & hole[t], fill, shown, found, pixels, PixelSource.OBJECT)


def _write_fill(
    filled: Filled, t: int, where: np.ndarray, fill: np.ndarray, shown: np.ndarray, found: np.ndarray, pixels: np.ndarray,
    source: PixelSource,
) -> None:  # fmt: skip
    confidence = np.zeros(where.shape, np.float32)
    confidence[pixels[:, 1], pixels[:, 0]] = 1 - np.exp(-found)
    filled.rgb[t][where] = np.clip(np.rint(fill[where]), 0, 255)
    filled.source[t][where] = np.where(shown[where], source, PixelSource.SPATIAL)
    filled.confidence[t][where] = np.where(shown, 255 * confidence, 0)[where]


def _fill_unseen(
    image: np.ndarray, pixels: np.ndarray, colour: np.ndarray, found: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Combine gathered colours with cv2.inpaint where no frame shows the point, (h, w, 3) float32."""
    fill = image.copy()
    fill[pixels[:, 1], pixels[:, 0]] = np.rint(colour)
    unseen = _mask(target.shape, pixels, found == 0)
    fill = telea_image(fill, unseen).astype(np.float32)
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
