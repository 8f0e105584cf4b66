"""Input of a sequence model: a picture, a video or a folder of frames, with optional depth.

Everything is cropped to its middle square and resized here, so that motion is estimated on the grid that the model sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.folders import VIDEO_SUFFIXES
from afford.common.image_files import read_depth, read_image, read_intrinsics
from afford.common.text import natural_key
from afford.common.video.frames import every_nth
from afford.common.video.inputs import IMAGES
from afford.common.video.probe import probe
from schemas.interaction import BACKGROUND, InteractionClip

FOCAL_SHARE = 365.0 / 300
"""default focal length relative to the side of the square: a Kinect 2 cropped to 300 px, as in training"""
DEPTHS = (".png", ".npy")
MASKS = "target_"
"""prefix of files in SOR3D-AFF's layout that are not frames"""
FITS = "depth must lie on the grid of the colours"


@dataclass(frozen=True)
class Sampling:
    """Choice of the frames of a video."""

    rate_hz: float = 10.0
    frames: int = 10
    """maximum number of frames, the last ones"""


@dataclass(frozen=True)
class Lens:
    """Camera parameters: a file with the intrinsic matrix, a focal length in px of the picture, or neither."""

    intrinsics: Path | None = None
    focal_px: float | None = None


@dataclass(frozen=True)
class Footage:
    """A sequence at the size of a model, and its last picture in full."""

    clip: InteractionClip
    """without label; depth is 0 where there is none"""
    rgb: np.ndarray
    """(h, w, 3) uint8, the whole last picture"""
    square: tuple[int, int, int]
    """top, left, side of the model's square in it, px"""
    frame: int | None
    """number of the last frame of a video, from 1"""
    has_depth: bool


def read_footage(path: Path, depth: Path | None, lens: Lens, sampling: Sampling, size_px: int) -> Footage:
    """Read a sequence. SourceError when a file cannot be read, or when depth and colours differ in size."""
    if path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir():
        frames, numbers, of = _video(path, sampling)
    else:
        frames, numbers, of = _pictures(path, sampling)
    depths = _depths(depth, numbers, of, frames[-1].shape[:2]) if depth is not None else []
    K, square = _camera(lens, frames[-1].shape[:2])
    rgb = np.stack([_square(one, square, size_px, cv2.INTER_AREA) for one in frames])
    far = [_square(one, square, size_px, cv2.INTER_NEAREST) for one in depths]
    depth_m = np.stack(far) if far else np.zeros(rgb.shape[:3], np.float32)
    label = np.full((size_px, size_px), BACKGROUND, np.uint8)
    clip = InteractionClip(path.stem, "", "", "", rgb, depth_m, _scaled(K, square, size_px), label, sampling.rate_hz,
                           np.zeros((0, 3), np.float32))  # fmt: skip
    return Footage(clip, frames[-1], square, numbers[-1] + 1 if path.suffix.lower() in VIDEO_SUFFIXES else None, bool(depths))


def _video(path: Path, sampling: Sampling) -> tuple[list[np.ndarray], list[int], int]:
    """Frames at whole steps of 1 / rate before and including the last one, their numbers from 0, and the count of all frames."""
    try:
        times_s = probe(path).times_s
        before = np.arange(sampling.frames)[::-1] / sampling.rate_hz
        wanted = times_s[-1] - before
        numbers = np.unique(np.abs(times_s[None] - wanted[wanted > -0.5 / sampling.rate_hz][:, None]).argmin(1)).tolist()
        found = {number - 1: rgb for number, _, rgb in every_nth(path, 1) if number - 1 in numbers}
    except (ValueError, OSError) as error:
        raise SourceError(str(path), "a video that can be read", str(error), "get the file again") from error
    kept = sorted(found)
    if not kept:
        raise SourceError(str(path), "a video with frames", "none that can be decoded", "get the file again")
    return [found[n] for n in kept], kept, len(times_s)


def _pictures(path: Path, sampling: Sampling) -> tuple[list[np.ndarray], list[int], int]:
    """One picture, or the frames of a folder in numeric order."""
    listed = [path]
    if path.is_dir():
        listed = _numbered(path, IMAGES, (MASKS, "."))
    if not listed:
        raise SourceError(str(path), f"frames of one sequence ({', '.join(IMAGES)})", "none", "give the folder of the frames")
    numbers = list(range(len(listed)))[-sampling.frames :]
    frames = [read_image(listed[n]) for n in numbers]
    unknown = next((n for n, frame in zip(numbers, frames, strict=True) if frame.shape != frames[-1].shape), None)
    if unknown is not None:
        raise SourceError(str(listed[unknown]), "frames of one size", "another one", "give a folder of one sequence")
    return frames, numbers, len(listed)


def _numbered(folder: Path, suffixes: tuple[str, ...], without: tuple[str, ...]) -> list[Path]:
    """Files of a folder in the numeric order of their names, without those with an excluded prefix."""
    found = [one for one in folder.iterdir() if one.suffix.lower() in suffixes and not one.name.startswith(without)]
    return sorted(found, key=lambda one: natural_key(one.name))


def _depths(path: Path, numbers: list[int], of: int, shape: tuple[int, ...]) -> list[np.ndarray]:
    """Depth of the frames `numbers` of `of`: one file, or a folder with one file per frame in numeric order."""
    files = [path]
    if path.is_dir():
        files = _numbered(path, DEPTHS, (".",))
    if len(files) != of:
        raise SourceError(str(path), f"{of} depth pictures, one for each frame", str(len(files)), "give a file for each frame")
    found = [read_depth(files[n]) for n in numbers]
    for n, depth in zip(numbers, found, strict=True):
        if depth.shape != shape:
            raise SourceError(str(files[n]), f"depth of {shape[1]} x {shape[0]} px like the picture",
                              f"{depth.shape[1]} x {depth.shape[0]}", FITS)  # fmt: skip
    return found


def _camera(lens: Lens, shape: tuple[int, ...]) -> tuple[np.ndarray, tuple[int, int, int]]:
    """K (3, 3) of the whole picture, and its middle square."""
    height, width = shape[:2]
    side = min(height, width)
    square = ((height - side) // 2, (width - side) // 2, side)
    if lens.intrinsics is not None:
        return read_intrinsics(lens.intrinsics), square
    focal = lens.focal_px or FOCAL_SHARE * side
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]]), square


def _scaled(K: np.ndarray, square: tuple[int, int, int], size_px: int) -> np.ndarray:
    """K of the square at the model's size; pixel centres are at integer coordinates."""
    top, left, side = square
    scale = size_px / side
    moved = K.astype(np.float64).copy()
    moved[:2, 2] = (moved[:2, 2] - (left, top) + 0.5) * scale - 0.5
    moved[[0, 1], [0, 1]] *= scale
    return moved


def _square(image: np.ndarray, square: tuple[int, int, int], size_px: int, how: int) -> np.ndarray:
    top, left, side = square
    cut = np.ascontiguousarray(image[top : top + side, left : left + side])
    return cut if side == size_px else cv2.resize(cut, (size_px, size_px), interpolation=_how(how, side, size_px))


def _how(how: int, side: int, size_px: int) -> int:
    """Interpolation: area averaging only for pictures that shrink."""
    return cv2.INTER_LINEAR if how == cv2.INTER_AREA and size_px > side else how
