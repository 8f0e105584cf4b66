"""Contact sheet of recordings: a PNG with pictures of moments spread evenly.

A clip has columns for frame, masks, removed hands, complete objects, affordances and text. Other recordings have strips of their
own: objects, grasps and pictures with curves (strips.py), interactions (interactions.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from afford.common.drawing import TILE_BACKGROUND, TILE_INK, TILE_W, pad_tile, title_row, write_page
from afford.recording.extraction_results import AFFORDANCE, COMPLETION_OVERLAY, INPAINTED, TRACKS_OVERLAY
from afford.recording.extraction_sources import FRAME_IMAGE, FRAME_STATE, NARRATION
from afford.recording.hands import KEYPOINTS
from afford.recording.interactions import interaction_strips, is_interaction
from afford.recording.moments import Moment, moments, tile_of
from afford.recording.strips import grasp_strips, is_grasp, is_object, object_strips, picture_strips

TEXT_W = 250
FAINT = (150, 156, 164)
WORDS_PER_LINE = 30
COLUMNS = (
    ("frame", FRAME_IMAGE, ""),
    ("hands and objects", FRAME_IMAGE, TRACKS_OVERLAY),
    ("hands removed", f"{INPAINTED}/image", ""),
    ("complete objects", f"{INPAINTED}/image", COMPLETION_OVERLAY),
    ("affordance", f"{INPAINTED}/image", f"{AFFORDANCE}/overlay"),
)
"""title, picture, overlay"""
KEYPOINT_COLUMN = 1
"""column on which keypoints of detected hands are drawn"""
STATE = f"{AFFORDANCE}/state"
KEYPOINTS_NEAR_NS = 100_000_000
"""largest distance in time of keypoints that are drawn on a frame"""
Strips = Callable[[Path], list[np.ndarray]]
OWN_STRIPS: tuple[tuple[Callable[[Path], bool], Strips], ...] = (
    (is_object, object_strips),
    (is_grasp, grasp_strips),
    (is_interaction, interaction_strips),
)
"""test for a kind of recording -> its strips; a sheet shows recordings of the first kind that matches any"""


def write_sheet(paths: Sequence[Path], out: Path, rows: int = 8) -> None:
    """Write a PNG with about `rows` rows spread over the recordings; ValueError when no recording has a picture."""
    for is_one, strips_of in OWN_STRIPS:
        if own := [path for path in paths if is_one(path)]:
            return write_page(out, [strip for path in own for strip in strips_of(path)])
    each = max(1, rows // len(paths))
    found = [(path, moment) for path in paths for moment in _with_keypoints(path, _chosen(path, each))]
    if not found and (strips := [strip for path in paths for strip in picture_strips(path)]):
        return write_page(out, strips)
    if not found:
        raise ValueError(f"{paths[0]}: no pictures on {FRAME_IMAGE}; record the frames (frame_decode)")
    strips = [_row(path.stem, moment) for path, moment in found]
    write_page(out, [title_row([title for title, _, _ in COLUMNS] + ["task"], strips[0].shape[1]), *strips])


def _chosen(path: Path, rows: int) -> list[Moment]:
    """Moments spread evenly over the frames that become samples, or over all frames when those are too few."""
    times = [m.time_ns for m in moments(path, [FRAME_IMAGE])]
    good = [m.time_ns for m in moments(path, [STATE]) if m.one(STATE).accepted]
    pool = good if len(good) >= rows else times
    picked = sorted({pool[int(i)] for i in np.linspace(0, len(pool) - 1, min(rows, len(pool)))}) if pool else []
    return list(moments(path, times_ns=picked))


def _with_keypoints(path: Path, chosen: list[Moment]) -> list[Moment]:
    """Add the keypoints of detected hands that are nearest in time to each moment, since these are of sampled frames."""
    drawn = {moment.time_ns: moment.values[KEYPOINTS] for moment in moments(path, [KEYPOINTS])}
    for moment in chosen:
        near = min(drawn, key=lambda time_ns: abs(time_ns - moment.time_ns), default=None)
        if near is not None and abs(near - moment.time_ns) <= KEYPOINTS_NEAR_NS:
            moment.values[KEYPOINTS] = drawn[near]
    return chosen


def _draw_keypoints(tile: np.ndarray, moment: Moment) -> np.ndarray:
    """Draw the bones of detected hands on the tile (h, TILE_W, 3) of a frame."""
    drawn, picture = moment.one(KEYPOINTS), moment.picture(FRAME_IMAGE)
    if drawn is None or picture is None:
        return tile
    page, scale = Image.fromarray(tile), TILE_W / picture.shape[1]
    pen = ImageDraw.Draw(page, "RGBA")
    for part in drawn.points:
        if part.type == part.LINE_STRIP:
            colour = part.outline_color
            pen.line([(point.x * scale, point.y * scale) for point in part.points], width=2,
                     fill=tuple(round(255 * one) for one in (colour.r, colour.g, colour.b, colour.a)))  # fmt: skip
    return np.asarray(page)


def _row(name: str, moment: Moment) -> np.ndarray:
    tiles = [tile_of(moment, picture, overlay) for _, picture, overlay in COLUMNS]
    frame = tiles[KEYPOINT_COLUMN]
    if frame is not None:
        tiles[KEYPOINT_COLUMN] = _draw_keypoints(frame, moment)
    height = max(tile.shape[0] for tile in tiles if tile is not None)
    blank = np.full((height, TILE_W, 3), TILE_BACKGROUND, np.uint8)
    shown = [blank if tile is None else tile for tile in tiles] + [_text_tile(name, moment, height)]
    return np.concatenate([pad_tile(tile) for tile in shown], axis=1)


def _text_tile(name: str, moment: Moment, height: int) -> np.ndarray:
    """Text of a moment as a picture (height, TEXT_W, 3)."""
    state = moment.one(STATE)
    page = Image.new("RGB", (TEXT_W, height), TILE_BACKGROUND)
    draw, y = ImageDraw.Draw(page), 6
    for text, size, colour in _lines(name, moment, state):
        for line in wrap(text, round(WORDS_PER_LINE * 14 / size))[:3]:
            draw.text((10, y), line, fill=colour, font=ImageFont.load_default(size))
            y += size + 5
    return np.asarray(page)


def _lines(name: str, moment: Moment, state: Any) -> list[tuple[str, int, tuple[int, int, int]]]:
    frame = getattr(moment.one(FRAME_STATE), "frame", "?")
    lines = [(f"{name}  frame {frame}  {moment.time_ns / 1e9:.2f} s", 12, FAINT)]
    narrations = moment.values.get(NARRATION, [])
    lines += [(n.text, 17, TILE_INK) for n in narrations[:2]] or [("(no narration)", 14, FAINT)]
    lines += [(f"{n.verb} / {n.noun}", 12, FAINT) for n in narrations[:1]]
    if state is not None:
        hands = f"left: {state.left_object or 'none'}, right: {state.right_object or 'none'}"
        verdict = f"quality {state.quality:.2f}" if state.accepted else f"no sample: {state.rejection}".replace("_", " ")
        lines += [(state.taxonomy.replace("_", " "), 14, TILE_INK), (hands, 12, FAINT), (verdict, 12, FAINT)]
    return lines
