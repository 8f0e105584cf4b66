"""A small clip by hand: a textured card moves and turns over a panning background while a hand comes and holds it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from schemas.masks import Entity, TrackFlag, Tracks
from schemas.video import Frames

HEIGHT, WIDTH = 96, 160
ENTITIES = (
    Entity("left hand", "left hand", -1, "hand", "left"),
    Entity("right hand", "right hand", -1, "hand", "right"),
    Entity("card", "card", 7, "object", ""),
)


@dataclass(frozen=True)
class Toy:
    """Frames and tracks, and what is true: `amodal` (t, h, w) bool of the card, `clean` (t, h, w, 3) uint8 without hand."""

    frames: Frames
    tracks: Tracks
    amodal: np.ndarray
    clean: np.ndarray


def toy(count: int = 25, seed: int = 0, rows: slice = slice(None)) -> Toy:
    """`count` frames, of which `rows` are kept; the hand is away in the first and the last fifth."""
    rng = np.random.default_rng(seed)
    ground, card = texture(rng, HEIGHT + 60, WIDTH + 60, (150, 110, 80)), texture(rng, 44, 30, (90, 130, 160))
    shots = [_shot(ground, card, s) for s in np.linspace(0, 1, count)[rows]]
    clean, amodal, hand = (np.stack(part) for part in zip(*shots, strict=True))
    rgb = np.where(hand[..., None], np.array([205, 150, 120]), clean) + rng.normal(0, 2, clean.shape)
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    frame = np.arange(1, count + 1)[rows].astype(np.int64)
    frames = Frames("toy", frame, frame * 33_333_333, rgb)
    return Toy(frames, tracks(frame, hand, amodal & ~hand), amodal, clean.astype(np.uint8))


def tracks(frame: np.ndarray, hand: np.ndarray, card: np.ndarray) -> Tracks:
    """Tracks with a right hand that touches the card wherever it is in sight."""
    masks = np.stack([np.zeros_like(hand), hand, card])
    size, seen = masks.shape[:2], masks.any(axis=(2, 3))
    contact = np.full((2, len(frame)), -1, np.int16)
    contact[1, seen[1]] = 2
    return Tracks(
        "toy", ENTITIES, frame, masks, seen.astype(np.float32), (seen * (TrackFlag.VISIBLE | TrackFlag.KEY)).astype(np.uint8),
        np.tile(frame, (3, 1)), np.zeros(size, np.int32), contact, np.zeros((2, len(frame)), np.int32),
    )  # fmt: skip


def texture(rng: np.random.Generator, height: int, width: int, colour: tuple[int, int, int]) -> np.ndarray:
    """(h, w, 3) float32 noise in three sizes around a colour."""
    octaves = [(3, 10), (8, 18), (30, 25)]
    noise = [rng.normal(size=(height // s + 2, width // s + 2, 3)) * a for s, a in octaves]
    layers = [cv2.resize(n, (width, height), interpolation=cv2.INTER_CUBIC) for n in noise]
    return np.clip(sum(layers) + np.array(colour), 0, 255).astype(np.float32)


def _shot(ground: np.ndarray, card: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pan = np.array([[1, 0.02 * s, -15 - 20 * s], [-0.02 * s, 1, -15 - 8 * np.sin(3 * s)]])
    angle, at = 0.5 * np.sin(4 * s), np.array([70 + 20 * np.sin(3 * s), 48 - 10 * s])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place = np.column_stack([turn, at - turn @ [15, 22]])
    mask = cv2.warpAffine(np.ones(card.shape[:2], np.float32), place, (WIDTH, HEIGHT)) > 0.5
    thing = cv2.warpAffine(card, place, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
    clean = np.where(mask[..., None], thing, cv2.warpAffine(ground, pan, (WIDTH, HEIGHT)))
    reach = float(np.clip(min(s, 1 - s) * 5, 0, 1))
    tip = (int(at[0]) + 6, int(at[1] + 9 + 70 * (1 - reach)))
    hand = cv2.line(cv2.circle(np.zeros((HEIGHT, WIDTH), np.uint8), tip, 11, 1, -1), tip, (120, HEIGHT + 30), 1, 12)
    return clean, mask, hand > 0
