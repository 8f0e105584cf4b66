"""An EPIC-format root with truth, made in a second: in each of two short videos a hand comes, holds a card and leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from afford.codecs import save
from afford.common.video.frames import write_video
from afford.extraction.sources.outlines import trace
from schemas.scene import ClipTruth
from tests.helpers import tiny_root
from tests.helpers.toy_clip import ENTITIES, HEIGHT, WIDTH, Toy, toy

VIDEOS = ("P96_01", "P96_02")
FRAMES, KEYS = 19, (1, 7, 13, 19)


def write_source(root: Path, videos: tuple[str, ...] = VIDEOS, truth: bool = False) -> Path:
    """A root of these videos; `truth` adds what extraction_score wants."""
    for seed, video in enumerate(videos):
        clip = toy(FRAMES, seed)
        write_video(media(root, video), clip.frames.rgb, 18)
        tiny_root.write_points(root, video, [_point(video, clip, frame) for frame in KEYS])
        if truth:
            folder = root / "truth" / video
            folder.mkdir(parents=True)
            save(_truth(video, clip), folder)
    write_narrations(root, {video: {} for video in videos})
    (root / "EPIC_100_verb_classes.csv").write_text("id,key,instances,category\n0,take,\"['pick-up', 'take']\",x\n")
    (root / "EPIC_100_noun_classes_v2.csv").write_text("id,key,instances,category\n7,card,\"['card']\",x\n")
    return root


def media(root: Path, video: str) -> Path:
    """Path of the video."""
    return root / "videos" / f"{video}.MP4"


def write_narrations(root: Path, videos: dict[str, dict[str, Any]]) -> None:
    """One narration per video, with columns that differ from 'pick up card'."""
    given = {"narration": "pick up card", "noun": "card", "noun_class": 7, "all_nouns": "['card']", "all_noun_classes": "[7]",
             "stop_frame": FRAMES}
    tiny_root.write_rows(root / "EPIC_100_train.csv", [tiny_root.row(video, **given | more) for video, more in videos.items()])


def _point(video: str, clip: Toy, frame: int) -> dict[str, Any]:
    """The VISOR datapoint of a frame, on the grid of the video itself."""
    seen = {entity.name: _segments(clip.tracks.masks[i, frame - 1]) for i, entity in enumerate(ENTITIES)}
    contact = {"right hand": {"in_contact_object": f"card@{frame}"}}
    rows = [tiny_root.mask(name, f"{name}@{frame}", segments, **contact.get(name, {}))
            for name, segments in seen.items() if segments]
    point = tiny_root.image(video, frame, rows)
    point["image"] |= {"width": WIDTH, "height": HEIGHT}
    return point


def _segments(mask: np.ndarray) -> list[list[list[float]]]:
    return [polygon.points.tolist() for polygon in trace(mask)]


def _truth(video: str, clip: Toy) -> ClipTruth:
    tracks, size = clip.tracks, (FRAMES, HEIGHT, WIDTH)
    amodal = np.stack([tracks.masks[0], tracks.masks[1], clip.amodal])
    return ClipTruth(
        clip_id=video, hard=(), entities=ENTITIES, frame=tracks.frame, visible=tracks.masks, amodal=amodal, rgb_no_hands=clip.clean,
        rgb_no_hands_shadow=clip.clean, depth_mm=np.full(size, 500, np.uint16), contact=tracks.contact,
        contact_mask=np.zeros((2, *size), bool), K=np.eye(3), T_world_cam=np.tile(np.eye(4), (FRAMES, 1, 1)))
