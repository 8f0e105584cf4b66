"""Search of a clip for hands: palm detection in windows of several sizes, landmarks, and tracking forwards and backwards.

The library detects palms in the whole picture, of which the network reads 192 pixels: hands of a head camera at a table are often
too small for that. Here square windows are read as well, and a hand that was found once is tracked in both directions of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from afford.common.video.frames import decode_chosen
from afford.extraction.landmarks.files import HAND, PALM
from afford.extraction.landmarks.geometry import hand_size, palm_centre
from afford.extraction.landmarks.landmarks import HandLandmarker, Landmarks
from afford.extraction.landmarks.palm import Palm, PalmDetector, box_iou
from afford.extraction.landmarks.parameters import Search
from afford.extraction.landmarks.region import Region
from afford.extraction.tracks.key_frames import evenly_spaced, runs
from schemas.files import FileTree
from schemas.hands import HandLandmarks
from schemas.video import Footage

CHUNK = 48
"""sampled frames in memory at a time"""
WINDOW_STEP = 0.6
"""distance between neighbouring windows, as a share of their side"""
WIDE = 1.3
"""side of the window with a margin, in which palms at the border of the picture are found"""
HANDS, PERSON = 1, 2
"""frames with so many hands are not searched in fine windows, or by colour"""
FINE = 0.5
"""side of the fine windows, as a share of the shorter side of the picture"""
LEARNED = 0.8
"""presence of a hand from which its colours are learned"""
ABSENT, CERTAIN = 0.05, 0.9
"""presence below which a region is given up, and above which its landmarks are not refined"""
SAME, SAME_CENTRE = 0.7, 0.5
"""two detections are one hand when their keypoints or their centres are nearer than this, in sizes of the hand"""
JUMP = 1.5
"""largest mean motion of the keypoints between sampled frames while a hand is tracked, in sizes of the hand"""


class Proposals(Protocol):
    """Regions that may show hands, by what was learned of the hands of a clip."""

    def learn(self, rgb: np.ndarray, hands_px: Sequence[np.ndarray]) -> None:
        """Learn from certain hands, keypoints (21, 2) each, of a picture (h, w, 3) uint8."""
        ...

    def regions(self, rgb: np.ndarray, hands_px: Sequence[np.ndarray]) -> list[Region]:
        """Propose regions in a picture, away from the hands that are known."""
        ...


def search_clip(media: FileTree, footage: Footage, models: Path, params: Search, proposals: Proposals) -> HandLandmarks:
    """Detect the landmarks of all hands in sampled frames of a clip. `models` is the folder of the two TFLite files."""
    finder = HandSearch(PalmDetector(models / PALM), HandLandmarker(models / HAND), params, proposals)
    number, time_ns, found, size = list[np.ndarray](), list[np.ndarray](), list[list[Landmarks]](), (1, 1)

    def choose(frame: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        parts = [evenly_spaced(time_s[part], params.look_s) + part.start for part in runs(frame, 1)] if len(frame) else []
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)

    for chunk_number, chunk_ns, rgb in decode_chosen(media, footage, (params.width_px, params.height_px), choose, CHUNK):
        if len(rgb):
            last = found[-1] if found and not _apart(number[-1][-1], chunk_number[0], time_ns[-1][-1], chunk_ns[0], params) else []
            found += finder.search(rgb, last)
            number, time_ns, size = [*number, chunk_number], [*time_ns, chunk_ns], (rgb.shape[2], rgb.shape[1])
    if not number:
        raise ValueError(f"{footage.clip_id}: no frame could be decoded; get the file again")
    return _table(footage.clip_id, np.concatenate(number), np.concatenate(time_ns), size, found)


def _apart(before: int, after: int, before_ns: int, after_ns: int, params: Search) -> bool:
    """Test for a gap of the video between two sampled frames."""
    return bool(after - before > 1 and after_ns - before_ns > 3e9 * params.look_s)


def _table(clip_id: str, frame: np.ndarray, time_ns: np.ndarray, size: tuple[int, int],
           found: Sequence[Sequence[Landmarks]]) -> HandLandmarks:  # fmt: skip
    every = [one for here in found for one in here]

    def column(values: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
        return np.array(values, np.float32).reshape(-1, *shape)

    return HandLandmarks(
        clip_id, frame, time_ns, *size, np.repeat(np.arange(len(found)), [len(here) for here in found]).astype(np.int32),
        column([one.points_px for one in every], (21, 2)), column([one.points_m for one in every], (21, 3)),
        column([np.array(one.presence) for one in every], ()), column([np.array(one.right) for one in every], ()),
    )  # fmt: skip


class HandSearch:
    """Search of consecutive sampled frames for hands."""

    def __init__(self, palms: PalmDetector, landmarker: HandLandmarker, params: Search, proposals: Proposals) -> None:
        self._palms, self._landmarker, self._params, self._proposals = palms, landmarker, params, proposals

    def search(self, rgb: np.ndarray, before: Sequence[Landmarks] = ()) -> list[list[Landmarks]]:
        """Find the hands of each of (t, h, w, 3) uint8 frames; `before` are those of the frame before the first."""
        p = self._params
        found = [self._detect(image, self._windows(image, k)) for k, image in enumerate(rgb)]
        self._track(rgb, found, before)
        if p.fine_every:
            for k in range(0, len(rgb), p.fine_every):
                if len(found[k]) < HANDS:
                    found[k] = unique([*found[k], *self._detect(rgb[k], windows(rgb[k], FINE))])
            self._track(rgb, found, before)
        if p.colour_every:
            for k in range(0, len(rgb), p.colour_every):
                self._proposals.learn(rgb[k], [one.points_px for one in found[k] if one.presence >= LEARNED])
            for k in range(0, len(rgb), p.colour_every):
                if len(found[k]) < PERSON:
                    found[k] = unique([*found[k], *self._propose(rgb[k], found[k])])
            self._track(rgb, found, before)
        return found

    def _propose(self, rgb: np.ndarray, known: Sequence[Landmarks]) -> list[Landmarks]:
        """Detect hands in regions that their colours propose."""
        hands = [self._refined(rgb, region) for region in self._proposals.regions(rgb, [one.points_px for one in known])]
        return [hand for hand in hands if hand.presence >= self._params.min_proposed]

    def _windows(self, rgb: np.ndarray, k: int) -> list[Window]:
        """Windows in which frame k is searched: the whole picture; sometimes squares of its height, and one with a margin."""
        whole, every = window_around(rgb, 1.0), self._params.windows_every
        return [whole, *windows(rgb, 1.0), window_around(rgb, WIDE)] if every and k % every == 0 else [whole]

    def _detect(self, rgb: np.ndarray, squares: Sequence[Window]) -> list[Landmarks]:
        """Detect hands in square windows."""
        palms = [palm for window in squares for palm in self._palms.detect(rgb, self._params.min_palm, window)]
        hands = [self._refined(rgb, palm.region()) for palm in best_palms(palms)]
        return unique([hand for hand in hands if hand.presence >= self._params.min_presence])

    def _refined(self, rgb: np.ndarray, region: Region) -> Landmarks:
        """Compute landmarks, and again in the region that they give; the better of both."""
        first = self._landmarker.landmarks(rgb, region)
        if not ABSENT <= first.presence < CERTAIN:
            return first
        return max(first, self._landmarker.landmarks(rgb, first.next_region()), key=lambda one: one.presence)

    def _track(self, rgb: np.ndarray, found: list[list[Landmarks]], before: Sequence[Landmarks]) -> None:
        """Track the hands of each frame into its neighbours, forwards and then backwards, where they were not detected."""
        for k in range(len(rgb)):
            self._follow(rgb[k], found[k - 1] if k else before, found[k])
        for k in range(len(rgb) - 2, -1, -1):
            self._follow(rgb[k], found[k + 1], found[k])

    def _follow(self, rgb: np.ndarray, neighbours: Sequence[Landmarks], here: list[Landmarks]) -> None:
        for one in neighbours:
            if any(same_hand(one, other) for other in here):
                continue
            moved = self._refined(rgb, one.next_region())
            apart = np.linalg.norm(moved.points_px - one.points_px, axis=1).mean() / hand_size(one.points_px)
            known = any(same_hand(moved, other) for other in here)
            if moved.presence >= self._params.min_presence and apart < JUMP and not known:
                here.append(moved)


Window = tuple[float, float, float]
"""x0, y0, side of a square, px"""


def window_around(rgb: np.ndarray, share: float) -> Window:
    """Square around the middle of a picture; `share` is its side as a share of the longer side of the picture."""
    height, width = rgb.shape[:2]
    side = share * max(height, width)
    return (width - side) / 2, (height - side) / 2, side


def windows(rgb: np.ndarray, share: float) -> list[Window]:
    """Square windows (x0, y0, side) that cover a picture; `share` is their side as a share of its shorter side.

    Empty where one window would be the whole picture.
    """
    height, width = rgb.shape[:2]
    side = share * min(height, width)
    if side > 0.87 * max(height, width):
        return []
    return [(x, y, side) for y in _starts(height, side) for x in _starts(width, side)]


def _starts(length: float, side: float) -> list[float]:
    count = int(np.ceil((length - side) / (WINDOW_STEP * side))) + 1
    return [float(at) for at in np.linspace(0, length - side, count)]


def best_palms(palms: Sequence[Palm]) -> list[Palm]:
    """Suppress palms that overlap with better ones of other windows, best first."""
    kept: list[Palm] = []
    for palm in sorted(palms, key=lambda one: -one.score):
        boxes = np.array([one.box_px.reshape(2, 2) for one in kept])
        if not kept or box_iou(palm.box_px.reshape(2, 2), boxes).max() < 0.3:
            kept.append(palm)
    return kept


def unique(hands: Sequence[Landmarks]) -> list[Landmarks]:
    """Suppress detections of the same hand, most certain first."""
    kept: list[Landmarks] = []
    for hand in sorted(hands, key=lambda one: -one.presence):
        if not any(same_hand(hand, other) for other in kept):
            kept.append(hand)
    return kept


def same_hand(one: Landmarks, other: Landmarks) -> bool:
    """Test whether two detections of one frame are the same hand."""
    size = max(hand_size(one.points_px), hand_size(other.points_px))
    apart = np.linalg.norm(one.points_px - other.points_px, axis=1).mean()
    return bool(apart < SAME * size
                or np.linalg.norm(palm_centre(one.points_px) - palm_centre(other.points_px)) < SAME_CENTRE * size)  # fmt: skip
