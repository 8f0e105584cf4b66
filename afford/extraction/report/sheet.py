"""Pictures beside the numbers: one row per clip, at the frame where the hands hide most of the objects."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.drawing import draw_label
from afford.common.image_files import encode_jpeg
from afford.common.palette import LEFT, RIGHT, Palette, colours_of
from afford.extraction.report.score import Aligned
from schemas.affordance import Affordances
from schemas.masks import CompleteObjects, Tracks
from schemas.video import Frames, Inpainted

JPEG_QUALITY = 88
AT_PX, LETTERS_PX = (6, 4), 13
"""where the label of a row stands, and how tall its letters are"""
TITLES = ("frame", "masks", "hands removed", "truth", "complete objects", "affordance")


def clip_row(
    aligned: Aligned,
    frames: Frames,
    tracks: Tracks,
    inpainted: Inpainted,
    complete: CompleteObjects,
    affordances: Affordances,
    width_px: int,
) -> np.ndarray:
    """JPEG bytes (b,) uint8 of six pictures side by side."""
    t = busiest(aligned)
    rgb = frames.rgb[t]
    shown = [
        rgb,
        paint(rgb, tracks.masks[:, t], colours_of(tracks.entities)),
        inpainted.rgb[t],
        aligned.truth.rgb_no_hands_shadow[aligned.at[t]],
        paint(inpainted.rgb[t], complete.masks[:, t], colours_of(complete.entities)),
        paint(inpainted.rgb[t], affordances.masks[:, t], (LEFT, RIGHT)),
    ]
    name = f"{aligned.truth.clip_id} #{frames.frame[t]}"
    row = np.hstack([_fit(image, width_px) for image in shown])
    draw_label(row, name + (" hard: " + ", ".join(aligned.truth.hard) if aligned.truth.hard else ""), AT_PX, LETTERS_PX)
    return encode_jpeg(row, JPEG_QUALITY)


def busiest(aligned: Aligned) -> int:
    """Row of the frame in which hands hide most pixels of the objects they touch."""
    hands = aligned.hands()
    hidden = np.zeros(len(aligned.at))
    for t in range(len(aligned.at)):
        for entity_id in {aligned.touched(0, t), aligned.touched(1, t)} - {""}:
            hidden[t] += np.count_nonzero(aligned.amodal(entity_id)[t] & hands[t])
    return int(hidden.argmax())


def paint(rgb: np.ndarray, masks: np.ndarray, colours: Palette) -> np.ndarray:
    """`rgb` with each of the masks (n, h, w) bool tinted and outlined in its own colour."""
    out = rgb.copy()
    for mask, colour in zip(masks, colours, strict=True):
        out[mask] = (0.45 * out[mask] + 0.55 * np.array(colour, np.float32)).astype(np.uint8)
        outline, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, outline, -1, colour, 1)
    return out


def decode_jpeg(data: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 RGB of JPEG bytes (b,) uint8."""
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError(f"{data.size} bytes are no picture")
    return bgr[..., ::-1]


def _fit(rgb: np.ndarray, width_px: int) -> np.ndarray:
    height_px = round(rgb.shape[0] * width_px / rgb.shape[1])
    return cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
