"""Tiny sources for tests: videos whose frames carry their own number, EPIC roots and folders of one's own."""

from __future__ import annotations

import csv
import json
import struct
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from blake3 import blake3

from afford.common.folders import media_of
from afford.extraction.sources.discover import discover
from afford.extraction.sources.narrations import COLUMNS
from schemas.files import FileTree
from schemas.video import Clip, Frames
from stages.extraction import clip_footage, frame_decode, source_read

WIDTH, HEIGHT, BITS = 128, 64, 8
SQUARE = [[600.0, 400.0], [900.0, 400.0], [900.0, 700.0], [600.0, 700.0]]
OTHER = [[1000.0, 400.0], [1300.0, 400.0], [1300.0, 700.0], [1000.0, 700.0]]


def picture(number: int) -> np.ndarray:
    """(HEIGHT, WIDTH, 3) uint8 RGB: bars that spell `number` in binary, darker in the lower half."""
    bars = np.array([(number >> bit) & 1 for bit in range(BITS)], np.uint8) * 200 + 20
    image = np.repeat(np.repeat(bars[None], HEIGHT, 0), WIDTH // BITS, 1)[..., None].repeat(3, 2)
    image[HEIGHT // 2 :] //= 2
    return image


def spelt(image: np.ndarray) -> int:
    """The number that an upright (h, w, 3) picture spells."""
    bars = np.array_split(image[: image.shape[0] // 2, :, 0], BITS, axis=1)
    return sum(int(np.median(bar) > 110) << bit for bit, bar in enumerate(bars))


def write_video(
    path: Path, count: int, fps: Fraction = Fraction(30), ticks: Sequence[int] | None = None, codec: str = "libx264",
    turned: int = 0, front: bool = False,
) -> Path:
    """Pictures 1 to `count`, with B-frames and a key frame every 12.

    ticks: presentation times in 1/600 s. turned: quarter turns of the stored pictures, undone by the display matrix (mp4).
    front: the index is at the front of the file (mp4).
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    base = Fraction(1, 600) if ticks else 1 / fps
    with av.open(str(path), "w", options={"movflags": "+faststart"} if front else {}) as container:
        stream = container.add_stream(codec, rate=fps)
        stream.height, stream.width = np.rot90(picture(1), turned).shape[:2]
        stream.pix_fmt, stream.gop_size = "yuv420p", 12
        stream.codec_context.time_base = base
        for number in range(1, count + 1):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(np.rot90(picture(number), turned)), format="rgb24")
            frame.pts, frame.time_base = (ticks[number - 1] if ticks else number - 1), base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    if turned == 1:
        _turn_clockwise(path)
    return path


def _turn_clockwise(path: Path) -> None:
    """Write a display matrix of a quarter turn into the track header of an mp4 file."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44
    data[at : at + 36] = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, HEIGHT << 16, 0, 1 << 30)
    path.write_bytes(bytes(data))


def mask(name: str, key: str, segments: Any = (SQUARE,), **more: Any) -> dict[str, Any]:
    class_id = 300 if "hand" in name else 13
    return {"id": key, "name": name, "class_id": class_id, "exhaustive": "y", "segments": list(segments), **more}


def image(video: str, frame: int, annotations: Iterable[dict[str, Any]] | None = None) -> dict[str, Any]:
    """One VISOR datapoint; by default a left hand that holds a mug."""
    held = [mask("left hand", f"h{frame}", in_contact_object=f"m{frame}"), mask("mug", f"m{frame}", (OTHER,))]
    name = f"{video}_frame_{frame:010d}.jpg"
    return {"image": {"name": name, "image_path": f"{video}/{name}", "subsequence": f"{video}_seq_00001", "video": video},
            "annotations": list(held if annotations is None else annotations)}


def row(video: str, number: int = 0, **more: Any) -> dict[str, Any]:
    given = {"narration_id": f"{video}_{number}", "participant_id": video[:3], "video_id": video, "start_frame": 1,
             "stop_frame": 40, "narration": "pick up mug", "verb": "pick-up", "verb_class": 0, "noun": "mug", "noun_class": 13,
             "all_nouns": "['mug']", "all_noun_classes": "[13]"}
    return dict.fromkeys(COLUMNS, "") | given | more


def write_rows(path: Path, rows: Iterable[dict[str, Any]], columns: Sequence[str] = COLUMNS) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def write_root(
    root: Path, video: str = "P95_01", frames: int = 40, points: list[Any] | None = None, rows: list[Any] | None = None
) -> Path:
    """An EPIC root of one video with key frames 1, 16 and 31 and one narration."""
    write_video(root / "videos" / f"{video}.MP4", frames)
    write_points(root, video, points if points is not None else [image(video, frame) for frame in (1, 16, 31)])
    write_rows(root / "EPIC_100_train.csv", rows if rows is not None else [row(video)])
    (root / "EPIC_100_verb_classes.csv").write_text("id,key,instances,category\n0,take,\"['pick-up', 'take']\",x\n")
    (root / "EPIC_100_noun_classes_v2.csv").write_text("id,key,instances,category\n13,cup,\"['mug', 'cup']\",x\n")
    return root


def write_points(root: Path, video: str, points: list[Any]) -> Path:
    path = root / "GroundTruth-SparseAnnotations" / "annotations" / "train" / f"{video}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"video_annotations": points}), encoding="utf-8")
    return path


def digest(path: Path) -> str:
    return blake3(path.read_bytes()).hexdigest()


def trees(root: Path) -> dict[str, FileTree]:
    return {tree.name: tree for tree in discover(root, digest).videos}


def clips(root: Path, video: str = "P95_01", params: source_read.Params | None = None) -> tuple[Clip, ...]:
    return source_read.run(trees(root)[video], params or source_read.Params())


def decode(files: FileTree, clip: Clip, params: frame_decode.Params | None = None) -> Frames:
    """The frames of a clip, as the pipeline gets them: from its media and its footage alone."""
    footage = clip_footage.run(clip, clip_footage.Params())
    return frame_decode.run(media_of(files), footage, params or frame_decode.Params())
