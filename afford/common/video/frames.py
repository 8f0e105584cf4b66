"""Frames of a clip from a video file or from images, upright and at working size; writing of videos."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from afford.common.bounded import TooLargeError, check_image
from afford.common.errors import SourceError
from afford.common.folders import pack_of, read_file, read_pack
from afford.common.video.probe import Probe, frames_at, opened, packets, parse_frame_number, probe
from schemas.files import FileRef, FileTree
from schemas.video import Clip, Footage, Frames


def fit(width_px: int, height_px: int, box_wh: tuple[int, int]) -> tuple[int, int]:
    """Scale an image size (width, height) down into a box, with the aspect ratio kept and both sides even.

    The box is turned for upright images. Small images keep their size, except that odd sides become even.
    """
    long_px, short_px = max(box_wh), min(box_wh)
    box_w, box_h = (long_px, short_px) if width_px >= height_px else (short_px, long_px)
    scale = min(1.0, box_w / width_px, box_h / height_px)
    return _even(width_px * scale), _even(height_px * scale)


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))


def shrink(image: np.ndarray, box_wh: tuple[int, int]) -> np.ndarray:
    """Resize an image (h, w, 3) uint8 to its working size; each pixel is the mean of the area it covers."""
    size = fit(image.shape[1], image.shape[0], box_wh)
    if size == (image.shape[1], image.shape[0]):
        return image
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


Decoded = tuple[np.ndarray, np.ndarray, np.ndarray]
"""frame numbers (t,) int64, media time (t,) int64 ns, images (t, h, w, 3) uint8 RGB"""


def decode_video(path: Path, first: int, last: int, resample_fps: float | None, box_wh: tuple[int, int]) -> Decoded:
    """Decode frames `first` to `last` (data-set numbers); damaged and missing frames are left out.

    Times are those of the file, or those of the constant rate of a resampled video. Raises SourceError for an unreadable file.
    """
    info = probe(path)
    source = frames_at(info, resample_fps, path.name)
    numbers = np.arange(first, min(last, len(source)) + 1, dtype=np.int64)
    indices = source[numbers - 1]
    images = _images(path, info, info.pts[indices], box_wh)
    kept = np.array([int(info.pts[i]) in images for i in indices], bool)
    numbers, indices = numbers[kept], indices[kept]
    times_s = (numbers - 1) / resample_fps if resample_fps else info.times_s[indices]
    return numbers, np.rint(times_s * 1e9).astype(np.int64), np.array([images[int(info.pts[i])] for i in indices], np.uint8)


def every_nth(path: Path, every: int) -> Iterator[tuple[int, float, np.ndarray]]:
    """Yield every n-th frame: number from 1, media time in s, (h, w, 3) uint8 RGB at the file's own size.

    Damaged frames are left out. Raises SourceError for an unreadable file.
    """
    info = probe(path)
    wanted = {int(info.pts[n]): n for n in range(0, len(info.pts), every)}
    with opened(path) as (container, stream):
        for frame in _frames(container, stream, None):
            time = frame.pts if frame.pts is not None else frame.dts
            n = wanted.get(time) if time is not None else None
            if n is not None and not frame.is_corrupt:
                yield n + 1, float(info.times_s[n]), _upright(frame)


def _images(path: Path, info: Probe, pts: np.ndarray, box_wh: tuple[int, int]) -> dict[int, np.ndarray]:
    """Decode the frames with the wanted presentation times; return time -> image.

    Decoding starts at the key frame before them. If frames are missing, decoding restarts at the beginning: some containers seek to
    the wrong place or lose their clock.
    """
    wanted = set(pts.tolist())
    before = info.pts[info.is_key & (info.pts <= pts[:1])] if wanted else pts
    images = _decode(path, int(before[-1]), wanted, box_wh) if len(before) else {}
    return images if len(images) == len(wanted) else images | _decode(path, None, wanted, box_wh)


def _decode(path: Path, start: int | None, wanted: set[int], box_wh: tuple[int, int]) -> dict[int, np.ndarray]:
    last, images = max(wanted), {}
    with opened(path) as (container, stream):
        for frame in _frames(container, stream, start):
            time = frame.pts if frame.pts is not None else frame.dts
            if time is not None and time in wanted and not frame.is_corrupt:
                images[time] = shrink(_upright(frame), box_wh)
            if time is not None and time >= last:
                break
    return images


def _frames(container: av.container.InputContainer, stream: av.VideoStream, start: int | None) -> Iterator[av.VideoFrame]:
    """Decode frames in display order from the key frame at `start`; broken packets are skipped."""
    if start is not None:
        container.seek(start, stream=stream)
    for packet in packets(container, stream):
        try:
            yield from packet.decode()
        except av.error.InvalidDataError:
            continue


def _upright(frame: av.VideoFrame) -> np.ndarray:
    """Convert to RGB (h, w, 3) uint8, turned by the display matrix of the file."""
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), round(frame.rotation / 90) % 4))


def read_stills(pictures: Iterable[tuple[str, bytes]], box_wh: tuple[int, int]) -> np.ndarray:
    """Decode (name, bytes) of images to (t, h, w, 3) uint8 RGB.

    Raises SourceError for data that cannot be decoded and for an image whose size differs from the first one.
    """
    images: list[np.ndarray] = []
    first = ""
    for name, data in pictures:
        image, first = _decode_still(name, data, box_wh), first or name
        if images and image.shape != images[0].shape:
            raise SourceError(name, f"the shape of {first}, {_size(images[0])}", _size(image),
                              "frames of a video must have one shape")
        images.append(image)
    return np.stack(images)


def _decode_still(name: str, data: bytes, box_wh: tuple[int, int]) -> np.ndarray:
    try:
        check_image(data, name)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except TooLargeError:
        raise
    except (SourceError, cv2.error):
        image = None
    if image is None:
        raise SourceError(name, "an image", f"{len(data)} bytes that cannot be decoded", "get the file again")
    return shrink(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), box_wh)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def decode_clip(files: FileTree, clip: Footage, box_wh: tuple[int, int]) -> Frames:
    """Decode the frames of a clip, scaled into `box_wh`.

    Raises SourceError for unreadable media, and when no key frame is among the frames (no frame at all for a clip without key
    frames).
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
    number, time_ns = _stills(clip)
    return number, time_ns, read_stills(zip(clip.media, pictures(files, clip), strict=True), box_wh)


def _stills(clip: Footage) -> tuple[np.ndarray, np.ndarray]:
    """Frame numbers and media times (ns) of the images of a clip."""
    number = np.array([parse_frame_number(name) for name in clip.media], np.int64)
    return number, np.rint((number - 1) / clip.fps * 1e9).astype(np.int64)


Choose = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""frame numbers (t,), media time (t,) in s -> ascending positions of the chosen frames"""


def decode_chosen(files: FileTree, clip: Footage, box_wh: tuple[int, int], choose: Choose, chunk: int) -> Iterator[Decoded]:
    """Decode chosen frames of a clip, `chunk` at a time, so that memory does not grow with the length of the clip.

    Damaged and missing frames are left out. Raises SourceError for unreadable media.
    """
    if clip.media_kind == "video":
        video, rate = _find(files, clip.media[0]), clip.fps if clip.resample else None
        info = probe(video.path)
        source = frames_at(info, rate, video.path.name)
        number = np.arange(clip.first_frame, min(clip.last_frame, len(source)) + 1, dtype=np.int64)
        time_s = (number - 1) / rate if rate else info.times_s[source[number - 1]]
        chosen = choose(number, time_s)
        for at in (chosen[i : i + chunk] for i in range(0, len(chosen), chunk)):
            pts = info.pts[source[number[at] - 1]]
            images = _images(video.path, info, pts, box_wh)
            kept = [n for n, time in enumerate(pts.tolist()) if time in images]
            yield (number[at][kept], np.rint(time_s[at][kept] * 1e9).astype(np.int64),
                   np.array([images[int(pts[n])] for n in kept], np.uint8))  # fmt: skip
    else:
        number, time_ns = _stills(clip)
        wanted = set(choose(number, time_ns / 1e9).tolist())
        rows = (row for row in zip(itertools.count(), clip.media, pictures(files, clip)) if row[0] in wanted)
        while part := list(itertools.islice(rows, chunk)):
            rows_at = [n for n, _, _ in part]
            yield number[rows_at], time_ns[rows_at], read_stills([(name, data) for _, name, data in part], box_wh)


def pictures(files: FileTree, clip: Footage | Clip) -> Iterator[bytes]:
    """Yield the bytes of every image of a clip, from its pack or from single files."""
    whole = pack_of(files, clip.media[0])
    if whole is not None:
        return read_pack(whole, clip.media, clip.spans)
    return (read_file(_find(files, name).path, name) for name in clip.media)


X264 = {"preset": "medium", "x264-params": "threads=1:mbtree=0"}
"""no macroblock-tree rate control: with it, equal frames gave different bytes (measured, x264 core 165 on AVX-512)"""


def write_video(path: Path, images: Iterable[np.ndarray], crf: int, rate_hz: int = 30) -> None:
    """Write (h, w, 3) uint8 RGB images of one even size as H.264 in MP4; one thread, so that bytes are reproducible."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="mp4", container_options={"fflags": "+bitexact"}) as container:
        stream = container.add_stream("libx264", rate=rate_hz, options={"crf": str(crf), **X264})
        stream.pix_fmt = "yuv420p"
        stream.thread_count = 1
        stream.codec_context.time_base = Fraction(1, rate_hz)
        for number, image in enumerate(images):
            if not number:
                stream.height, stream.width = image.shape[:2]
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.pts = number
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
