"""The contact sheet of interactions: frames, motion, depth, what was said, and attention, a strip each; then the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from afford.common.drawing import pad_tile, title_row
from afford.recording.moments import moments, tile_of
from afford.recording.of_interaction import ACTION, ATTENTION, DEPTH_COLOUR, FLOW, IMAGE, SAID, SURE, TRUTH, WORDS

SHOWN, SIDE = 10, 150
"""frames at most, spread evenly, the last one among them; width of a tile in px"""
ROWS = {"frames": (IMAGE, ""), "motion that led to them": (FLOW, ""), "depth": (DEPTH_COLOUR, ""),
        "likeliest affordance": (IMAGE, SAID), "affordance, confident": (IMAGE, SURE), "attention": (ATTENTION, ""),
        "true affordance of the last frame": (IMAGE, TRUTH)}  # fmt: skip
"""title -> picture and overlay"""


def is_interaction(path: Path) -> bool:
    """Whether a recording is of an interaction."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return summary is not None and any(channel.topic == ACTION for channel in summary.channels.values())


def strips_of(path: Path) -> list[np.ndarray]:
    """A line of words, then titles and strips."""
    every = list(moments(path))
    chosen = [every[int(k)] for k in np.linspace(0, len(every) - 1, min(SHOWN, len(every)))]
    strips = []
    for title, (picture, overlay) in ROWS.items():
        mine = chosen[-1:] if overlay == TRUTH else chosen
        tiles = [pad_tile(t) for moment in mine if (t := tile_of(moment, picture, overlay, SIDE, False)) is not None]
        if tiles:
            strip = np.concatenate(tiles, axis=1)
            strips += [title_row([title], max(strip.shape[1], 4 * SIDE), SIDE), strip]
    said = " ".join(line.message for moment in every for line in moment.values.get(WORDS, []))
    return [title_row([f"{path.stem}   {said}"], 8 * SIDE, SIDE), *strips]
