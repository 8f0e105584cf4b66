"""The frames of a clip, from its video file or its images."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.errors import SourceError
from afford.common.number import parse_frame_number
from afford.common.video.decode import Decoded, decode_video
from afford.common.video.pack import pack_of, read_file, read_pack
from afford.common.video.stills import read_stills
from schemas.files import FileRef, FileTree
from schemas.video import Clip, Footage, Frames


def decode_clip(files: FileTree, clip: Footage, box_wh: tuple[int, int]) -> Frames:
    """Frames of a clip that fit into `box_wh`. SourceError when the media are unreadable or no key frame is among them (no frame
    at all, where none is a key frame yet).
    """
    is_video = clip.media_kind == "video"
    number, time_ns, rgb = (_from_video if is_video else _from_stills)(files, clip, box_wh)
    if not (set(clip.key_frames) & set(number.tolist()) if clip.key_frames else len(number)):
        got = f"{len(number)} frames, {number[0]} to {number[-1]}" if len(number) else "no frame at all"
        wanted = "a key frame" if clip.key_frames else "a frame"
        raise SourceError(clip.media[0], f"{wanted} of {clip.clip_id} among frames {clip.first_frame} to {clip.last_frame}", got,
                          "is the file cut short? get it again")
    return Frames(clip.clip_id, number, time_ns, rgb)


def _find(files: FileTree, name: str) -> FileRef:
    file = files.find(name)
    if file is None:
        raise SourceError(name, f"among the files of {files.name}", "nothing", "read the source again")
    return file


def _from_video(files: FileTree, clip: Footage, box_wh: tuple[int, int]) -> Decoded:
    video = _find(files, clip.media[0])
    rate = clip.fps if clip.resample else None
    return decode_video(video.path, clip.first_frame, clip.last_frame, rate, box_wh)


def _from_stills(files: FileTree, clip: Footage, box_wh: tuple[int, int]) -> Decoded:
    number = np.array([parse_frame_number(name) for name in clip.media], np.int64)
    time_ns = np.rint((number - 1) / clip.fps * 1e9).astype(np.int64)
    return number, time_ns, read_stills(zip(clip.media, pictures(files, clip), strict=True), box_wh)


def pictures(files: FileTree, clip: Footage | Clip) -> Iterator[bytes]:
    """The bytes of every image, out of the pack that holds them or files of their own."""
    whole = pack_of(files, clip.media[0])
    if whole is not None:
        return read_pack(whole, clip.media, clip.spans)
    return (read_file(_find(files, name).path, name) for name in clip.media)
