"""Videos of drawn hands with their landmarks: a flat hand in one colour that moves over a textured table."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.landmarks.geometry import arm_direction, draw_hand
from schemas.hands import HandLandmarks
from schemas.video import Frames
from tests.helpers.toy_clip import texture

FLAT = np.array([[0, 0], [-.35, -.2], [-.6, -.5], [-.75, -.75], [-.85, -1.0], [-.3, -.95], [-.33, -1.3], [-.35, -1.5], [-.36, -1.7],
                 [-.05, -1.0], [-.05, -1.4], [-.05, -1.65], [-.05, -1.85], [.18, -.95], [.2, -1.3], [.22, -1.5], [.23, -1.7],
                 [.4, -.82], [.46, -1.08], [.5, -1.25], [.53, -1.4]])  # fmt: skip
"""21 keypoints of a right hand with its fingers up, seen from the back, in lengths of the palm"""
SKIN = (205, 150, 125)
TABLE = (70, 105, 120)
SIZE_WH = (320, 180)


@dataclass(frozen=True, eq=False)
class MadeHand:
    """Path of one hand: the wrist in every frame, and the frames in which landmarks are found."""

    wrist_px: np.ndarray
    """(t, 2)"""
    palm_px: float = 34.0
    colour: tuple[int, int, int] | None = SKIN
    """None: nothing is drawn"""
    sleeve: tuple[int, int, int] | None = None
    found: tuple[int, ...] | None = None
    """None: all"""
    left: bool = False
    down: bool = False
    """fingers down, as of a person who sits opposite"""
    presence: float = 0.95

    def points(self, t: int) -> np.ndarray:
        """Keypoints (21, 2) in frame t."""
        shape = FLAT * ((-1 if self.left != self.down else 1), (-1 if self.down else 1))
        return np.asarray(self.wrist_px[t] + self.palm_px * shape)

    def mask(self, t: int) -> np.ndarray:
        """Visible skin (h, w) bool in frame t: the hand, and a bare forearm when there is no sleeve."""
        hand = draw_hand(SIZE_WH[::-1], self.points(t), 0.13)
        return hand if self.sleeve is not None else hand | self.arm(t)

    def arm(self, t: int) -> np.ndarray:
        """Forearm (h, w) bool in frame t, without the hand."""
        points, drawn = self.points(t), np.zeros(SIZE_WH[::-1], np.uint8)
        far = points[0] + 10 * self.palm_px * arm_direction(points)
        cv2.line(drawn, points[0].astype(int).tolist(), far.astype(int).tolist(), 1, round(0.5 * self.palm_px))
        return (drawn > 0) & ~draw_hand(SIZE_WH[::-1], points, 0.13)


def still(x: float, y: float, count: int) -> np.ndarray:
    """Path of a hand that rests."""
    return np.tile(np.array([x, y], float), (count, 1))


def path(start: tuple[float, float], stop: tuple[float, float], count: int) -> np.ndarray:
    """Path of a hand that moves evenly along a line."""
    return np.linspace(start, stop, count)


def made_video(hands: list[MadeHand], seed: int = 0) -> tuple[Frames, HandLandmarks]:
    """Render 10 frames a second of the hands over a table, and their landmarks at twice the size of the frames."""
    count = len(hands[0].wrist_px)
    table = texture(np.random.default_rng(seed), SIZE_WH[1], SIZE_WH[0], TABLE)
    rgb = np.stack([table] * count)
    rows: list[tuple[int, MadeHand]] = []
    for t in range(count):
        for hand in hands:
            if hand.sleeve is not None:
                rgb[t][hand.arm(t)] = hand.sleeve
            if hand.colour is not None:
                rgb[t][hand.mask(t)] = hand.colour
            if hand.found is None or t in hand.found:
                rows.append((t, hand))
    noise = np.random.default_rng(seed + 1).normal(0, 3, rgb.shape)
    frames = Frames("made", np.arange(1, count + 1, dtype=np.int64), (np.arange(count) * 100_000_000).astype(np.int64),
                    np.clip(rgb + noise, 0, 255).astype(np.uint8))  # fmt: skip
    points = np.array([hand.points(t) * 2 for t, hand in rows], np.float32).reshape(-1, 21, 2)
    metric = np.concatenate([(points - points.mean(1, keepdims=True)) * 0.001, np.zeros((len(rows), 21, 1))], -1)
    return frames, HandLandmarks(
        "made", frames.frame, frames.time_ns, 2 * SIZE_WH[0], 2 * SIZE_WH[1], np.array([t for t, _ in rows], np.int32), points,
        metric.astype(np.float32), np.array([hand.presence for _, hand in rows], np.float32),
        np.array([0.5] * len(rows), np.float32))  # fmt: skip
