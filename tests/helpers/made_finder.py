"""Lessons about hands that cost little: two tiny rooms, and made-up ones whose hands are plain shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maps.settings import Settings
from schemas.scene import LEFT_HAND, RIGHT_HAND, SLEEVE, TOUCHED, HandLessons

SMALL_TRAINING = replace(Settings.extraction.hands_train, steps=2, batch=2, width_px=64, height_px=32, warmup=1, judged=8,
                         validate_every=2)  # fmt: skip
FINDER = Settings.of(hand_plan=replace(Settings.extraction.hand_plan, rooms=1, val_rooms=1),
                     hand_lessons=replace(Settings.extraction.hand_lessons, pictures=12, width_px=96, height_px=64, supersample=1),
                     hands_train=SMALL_TRAINING)  # fmt: skip
"""the whole chain in some seconds"""


SKIN = (206, 158, 132)
COLOURS = {LEFT_HAND: SKIN, RIGHT_HAND: SKIN, SLEEVE: (30, 40, 160), TOUCHED: (20, 200, 60)}


def made_up(name: str, split: str, count: int = 8, size: tuple[int, int] = (64, 96)) -> HandLessons:
    """Make samples in which hands are skin-coloured bars from the near edge, with a thumb on the inner side.

    The left hand is at the left; the right hand holds a green object. Every fourth picture shows no hand.
    """
    rng = np.random.default_rng([*name.encode()])
    height, width = size
    pictures = rng.integers(40, 90, (count, height, width, 3)).astype(np.uint8)
    labels = np.zeros((count, height, width), np.uint8)
    for n in range(count):
        if n % 4:
            top, aside = (int(v) for v in rng.integers(height // 4, height // 2, 2))
            bars = ((LEFT_HAND, aside // 2), (RIGHT_HAND, width - 12 - aside // 2))
            for label, x in bars:
                labels[n, top:, x : x + 12] = label
                inner = x + 12 if label == LEFT_HAND else x - 6
                labels[n, top + 4 : top + 10, inner : inner + 6] = label
                labels[n, -6:, x : x + 12] = SLEEVE
            labels[n, top - 6 : top, bars[1][1] : bars[1][1] + 12] = TOUCHED
        for label, colour in COLOURS.items():
            pictures[n][labels[n] == label] = colour
    return HandLessons(name, split, pictures, labels)
