"""Keypoints of the two hands over time, in the picture and in metres, from the landmarks of their tracks."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands import Detection
from afford.extraction.hands.fuse import FoundHands
from afford.extraction.hands.metric import Lifting, camera_matrix, focal_px, lift
from afford.extraction.hands.motion import SampledFrames
from schemas.hands import HandTracks
from schemas.video import SIDES, Frames


def hand_tracks(clip_id: str, frames: Frames, sampled: SampledFrames, hands: FoundHands, params: Detection) -> HandTracks:
    """Collect keypoints and confidence of both hands in every sampled frame, and lift them to metres in the camera frame."""
    count, (height, width) = len(sampled.at), sampled.rgb.shape[1:3]
    seen = np.array([[k in hands.masks[side] for k in range(count)] for side in SIDES])
    points, confidence = np.zeros((2, count, 21, 2), np.float32), np.zeros((2, count, 21), np.float32)
    shape_m = np.zeros((2, count, 21, 3))
    for n, side in enumerate(SIDES):
        for k, one in hands.points[side].items():
            points[n, k], confidence[n, k], shape_m[n, k] = one.points_px, one.presence, one.points_m
    focal = focal_px(width, height, params.fov_deg)
    K, lifting = camera_matrix(width, height, focal), Lifting(hand_m=params.hand_m)
    metric = np.stack([lift(points[n], shape_m[n], confidence[n], sampled.time_s, K, lifting) for n in range(2)])
    return HandTracks(clip_id, frames.frame[sampled.at], frames.time_ns[sampled.at], width, height, seen, points, confidence,
                      metric, np.zeros((2, count, 5), np.float32), focal)  # fmt: skip
