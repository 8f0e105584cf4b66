"""Write grasp candidates: candidates.json, overlay.png with their axes, cloud.ply with the cloud and the hands as points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.files import write_json
from afford.common.image_files import encode_png
from afford.common.palette import HANDS
from afford.grasping.candidates.point_cloud import unproject
from schemas.grasp import TERMS, GraspCandidates, GraspScene, HandCandidates

FORMAT, RECORD, OVERLAY, CLOUD = "afford-grasps-1", "candidates.json", "overlay.png", "cloud.ply"
DRAWN = 3
"""grasps drawn for each hand; the best is drawn thick"""
AXIS_M = 0.04
TINT = 0.45
NEGATIVE = (214, 39, 40)
VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
HEAD = ("ply\nformat binary_little_endian 1.0\ncomment metres, camera frame: x right, y down, z forward\nelement vertex {}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n")  # fmt: skip


def write_candidates(scene: GraspScene, found: GraspCandidates, out: Path) -> None:
    """Write all three files to an existing folder."""
    write_json(out / RECORD, record(scene, found))
    (out / OVERLAY).write_bytes(encode_png(overlay(scene, found)[..., ::-1]).tobytes())
    (out / CLOUD).write_bytes(ply(scene, found))


def record(scene: GraspScene, found: GraspCandidates) -> dict[str, Any]:
    """Return the content of candidates.json."""
    pairs = [{"left": int(a), "right": int(b), "score": _round(value)}
             for (a, b), value in zip(found.pair, found.pair_score, strict=True)]  # fmt: skip
    return {"format": FORMAT, "look": scene.name, "frame": "camera: x right, y down, z forward; metres",
            "grasp_frame": "x along the thing, to a right hand's thumb; y out of the back of the hand; z to the fingers",
            "K": scene.K.tolist(), "up": [_round(value) for value in found.up] if found.up.any() else None,
            "hands": {hand.side: [_one(hand, n) for n in range(len(hand.score))] for hand in found.hands},
            "pairs": pairs}  # fmt: skip


def overlay(scene: GraspScene, found: GraspCandidates) -> np.ndarray:
    """Draw the grasps on the image, (h, w, 3) uint8.

    Regions are tinted, negative pixels red. Each grasp shows its approach in white and the span between the fingers in the hand's
    colour, with a dot at the thumb.
    """
    out = scene.rgb.astype(np.float32)
    for mask, colour in ((*zip(scene.region, HANDS.values(), strict=True), (scene.negative, NEGATIVE))):
        out[mask] = (1 - TINT) * out[mask] + TINT * np.array(colour)
    canvas = np.ascontiguousarray(np.rint(out).astype(np.uint8))
    for hand in found.hands:
        for n in reversed(range(min(DRAWN, len(hand.score)))):
            _draw(canvas, scene.K, hand, n, thick=2 if n == 0 else 1)
    return canvas


def ply(scene: GraspScene, found: GraspCandidates) -> bytes:
    """Return the coloured cloud and, as rows of points, thumb, fingers and approach of every grasp, as PLY."""
    seen = scene.depth_m > 0
    cloud = np.empty(int(seen.sum()), VERTEX)
    cloud["xyz"], cloud["rgb"] = unproject(scene.depth_m, scene.K)[seen], scene.rgb[seen]
    lines = [_line(*ends, HANDS[hand.side]) for hand in found.hands for n in range(len(hand.score)) for ends in _bones(hand, n)]
    rows = np.concatenate([cloud, *lines])
    return HEAD.format(len(rows)).encode() + rows.tobytes()


def _one(hand: HandCandidates, n: int) -> dict[str, Any]:
    T = hand.T_cam_grasp[n]
    return {"score": _round(hand.score[n]), "T_cam_grasp": [[_round(value) for value in row] for row in T],
            "approach": [_round(value) for value in hand.approach[n]], "width_m": _round(hand.width_m[n]),
            "tips_m": [[_round(value) for value in tip] for tip in hand.tips[n]],
            "terms": {name: _round(value) for name, value in zip(TERMS, hand.terms[n], strict=True)}}  # fmt: skip


def _bones(hand: HandCandidates, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (start, end) of lines: along the approach, and from above each fingertip down to it."""
    T, tips = hand.T_cam_grasp[n], hand.tips[n]
    back = AXIS_M * T[:3, 1]
    return [(T[:3, 3] + 2 * back, T[:3, 3]), *((tip + back, tip) for tip in tips)]


def _line(start: np.ndarray, end: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    rows = np.empty(33, VERTEX)
    rows["xyz"] = start + np.linspace(0, 1, len(rows))[:, None] * (end - start)
    rows["rgb"] = colour
    return rows


def _draw(canvas: np.ndarray, K: np.ndarray, hand: HandCandidates, n: int, thick: int) -> None:
    T, half = hand.T_cam_grasp[n], hand.width_m[n] / 2
    spots = T[:3, 3] + np.array([[0, 0, 0], [0, AXIS_M, 0], [0, 0, -half], [0, 0, half], [AXIS_M / 2, 0, 0]]) @ T[:3, :3].T
    flat = spots @ K.T
    if (flat[:, 2] <= 0).any():
        return
    place, back, thumb, fingers, _ = (tuple(int(v) for v in np.rint(row[:2] / row[2]).clip(-1e6, 1e6)) for row in flat)
    colour = tuple(int(v) for v in HANDS[hand.side])
    cv2.line(canvas, place, back, (255, 255, 255), thick, cv2.LINE_AA)
    cv2.line(canvas, thumb, fingers, colour, thick, cv2.LINE_AA)
    cv2.circle(canvas, thumb, thick + 1, colour, -1, cv2.LINE_AA)


def _round(value: float) -> float:
    return round(float(value), 6)
