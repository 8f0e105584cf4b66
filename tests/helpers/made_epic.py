"""An EPIC-KITCHENS / VISOR root as it is published, made of small files: frames as one tar a video, or as a folder, or zips."""

from __future__ import annotations

import io
import json
import tarfile
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from afford.extraction.sources.outlines import rasterise
from afford.extraction.sources.rows import outlines
from afford.synthetic.kitchens.epic_files import GRID_WH
from schemas.video import Annotation
from tests.helpers.tiny_root import image, picture, row, write_points, write_rows

VIDEO = "P03_101"
FPS = 50


def jpeg(shade: int = 1) -> bytes:
    """A small picture."""
    return bytes(cv2.imencode(".jpg", picture(shade))[1])


def drawn(segments: list[list[list[float]]], width_px: int, height_px: int) -> np.ndarray:
    """(height_px, width_px) bool, polygons of VISOR's JSON as the reader of sources draws them."""
    read = Annotation("", "", -1, "", "", "y", outlines(segments, "row"))
    return rasterise(read, *GRID_WH, width_px, height_px)


def write_tables(root: Path, videos: Sequence[str] = (VIDEO,), frames: int = 40, keys: Iterable[int] = (1, 16, 31)) -> Path:
    """Annotations, narrations, the list of videos and VISOR's frame mapping, in which every number is one more."""
    for video in videos:
        write_points(root, video, [image(video, key) for key in keys])
    write_rows(root / "EPIC_100_train.csv", [row(video) for video in videos])
    lines = [f"{video},{frames / FPS},50.0,1920x1080" for video in videos]
    (root / "EPIC_100_video_info.csv").write_text("\n".join(["video_id,duration,fps,resolution", *lines]) + "\n")
    mapping = {video: {f"{video}_frame_{key:010d}.jpg": f"frame_{key + 1:010d}.jpg" for key in keys} for video in videos}
    (root / "frame_mapping.json").write_text(json.dumps(mapping))
    return root


def write_tar(root: Path, video: str = VIDEO, frames: int = 40, data: bytes | None = None) -> Path:
    """The released frames of a video, P03/rgb_frames/P03_101.tar."""
    path = root / video[:3] / "rgb_frames" / f"{video}.tar"
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, "w") as archive:
        for number in range(1, frames + 1):
            content = jpeg(number) if data is None else data
            item = tarfile.TarInfo(f"./frame_{number:010d}.jpg")
            item.size = len(content)
            archive.addfile(item, io.BytesIO(content))
    return path


def write_zip(root: Path, video: str = VIDEO, keys: Iterable[int] = (1, 16, 31)) -> Path:
    """VISOR's own key frames, GroundTruth-SparseAnnotations/rgb_frames/train/P03/P03_101.zip."""
    path = root / "GroundTruth-SparseAnnotations" / "rgb_frames" / "train" / video[:3] / f"{video}.zip"
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for key in keys:
            archive.writestr(f"{video}_frame_{key:010d}.jpg", jpeg(key))
    return path


def write_folder(root: Path, video: str = VIDEO, frames: int = 600) -> Path:
    """The released frames of a video, unpacked; more than are files of their own."""
    path = root / video[:3] / "rgb_frames" / video
    path.mkdir(parents=True)
    for number in range(1, frames + 1):
        (path / f"frame_{number:010d}.jpg").write_bytes(jpeg(number % 7))
    return path
