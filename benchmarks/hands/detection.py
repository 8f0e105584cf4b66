"""Run hand detection on one video as a data set does, and turn its output into detections by frame."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from afford.common.folders import media_of
from benchmarks.hands.scoring import Found
from schemas.files import FileTree
from schemas.hands import HandTracks
from schemas.masks import Tracks
from schemas.video import SIDES, Frames
from stages.extraction import clip_footage, frame_decode, hand_detect, hand_landmarks, mask_densify, source_read

MODES = ("finder", "landmarks", "fused")


@dataclass(frozen=True)
class Models:
    """Files of the landmark networks, a trained hand finder, the network of held objects and MobileSAM, None where missing."""

    landmarks: FileTree | None
    finder: FileTree | None
    held: FileTree | None = None
    segment: FileTree | None = None

    def modes(self) -> tuple[str, ...]:
        """List the modes that these files allow."""
        allowed = {"finder": self.finder is not None, "landmarks": self.landmarks is not None}
        return tuple(mode for mode in MODES if allowed.get(mode, all(allowed.values())))


@dataclass
class Detected:
    """Detections of a video by frame number, the clips' frames, and the cost of finding."""

    found: dict[int, list[Found]] = field(default_factory=dict)
    frames: list[Frames] = field(default_factory=list)
    cpu_s: float = 0.0

    @property
    def count(self) -> int:
        """Number of video frames."""
        return sum(len(frames.frame) for frames in self.frames)


def run(files: FileTree, viewpoint: str, mode: str, models: Models) -> Detected:
    """Detect hands in a video without masks, in a mode of `MODES`, with the default parameters of the stages."""
    out, media = Detected(), media_of(files)
    backend = "landmarks" if mode == "landmarks" else "network"
    params = replace(hand_detect.Params(), viewpoint=viewpoint, backend=backend)  # type: ignore[arg-type]  # one of two
    for clip in source_read.run(files, source_read.Params()):
        footage = clip_footage.run(clip, clip_footage.Params())
        frames = frame_decode.run(media, footage, frame_decode.Params())
        started = time.process_time()
        seen = None
        if mode != "finder" and models.landmarks is not None:
            seen = hand_landmarks.run(media, footage, hand_landmarks.Params(), models.landmarks)
        held = {} if seen is None else {"held": models.held, "networks": models.landmarks}
        finder = models.finder if backend == "network" else None
        detected = hand_detect.run(clip, frames, params, seen, finder, **held, segment=models.segment)
        out.cpu_s += time.process_time() - started
        out.frames.append(frames)
        tracks = mask_densify.run(detected.clip, frames, mask_densify.Params())
        out.found.update(_by_frame(tracks, detected.hands))
    return out


def _by_frame(tracks: Tracks, hands: HandTracks) -> Iterator[tuple[int, list[Found]]]:
    """Yield the detections of every frame."""
    rows = {frame: t for t, frame in enumerate(hands.frame.tolist())}
    mine = {entity.side: k for k, entity in enumerate(tracks.entities) if entity.side}
    for t, frame in enumerate(tracks.frame.tolist()):
        here = [_found(tracks, hands, side, k, t, rows.get(frame)) for side, k in mine.items() if tracks.masks[k, t].any()]
        yield frame, here


def _found(tracks: Tracks, hands: HandTracks, side: str, k: int, t: int, row: int | None) -> Found:
    n, mask = SIDES.index(side), tracks.masks[k, t]  # type: ignore[arg-type]  # one of two
    touched = int(tracks.contact[n, t])
    thing = tracks.masks[touched, t] if touched >= 0 else None
    points = metres = None
    if row is not None and hands.confidence[n, row].max() > 0:
        points = hands.keypoints_px[n, row] * np.float32(mask.shape[1] / hands.width_px)
        metres = hands.keypoints_m[n, row]
    return Found(mask, side, touched >= 0, thing, points, metres, hands.focal_px / hands.width_px)
