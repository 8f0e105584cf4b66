"""Reading of one video, from any source, into clips: the only entry point of annotations."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from afford.common.errors import SourceError
from afford.extraction.sources.cut import ClipRange, Cutting, cut_video
from afford.extraction.sources.discover import DENSE, SPARSE
from afford.extraction.sources.key_frames import has_masks, read_keys
from afford.extraction.sources.media import Media, check_end, find_media
from afford.extraction.sources.narrations import DEFAULT_TASK, STANDARD, default_narration, frame_rates, video_narrations
from afford.extraction.sources.rows import Note
from schemas.files import FileTree
from schemas.video import Clip, KeyFrame, Narration

TAIL_SLACK_S = 0.5
"""tolerance of annotations after the end of the video: tools that count frames disagree at the end of a file"""
SPLITS = ("train", "val", "test")
UNNAMED = f"what hands touch in it is called '{' '.join(DEFAULT_TASK)}'"
Found = tuple[list[KeyFrame], list[Narration], list[int]]
"""key frames, narrations, and the frames at which the video may be cut"""


def read_clips(files: FileTree, cutting: Cutting, still_fps: float) -> tuple[Clip, ...]:
    """Read the clips of the video `files.name` in order of time. SourceError when the video or a file about it cannot be used.

    still_fps: rate of a folder of frame images without a rate in the source, 1/s.
    """
    return clips_of(files, media_of_video(files, still_fps), cutting)


def media_of_video(files: FileTree, still_fps: float) -> Media:
    """Find the frames of the video that exist; SourceError for a video without frames, and for a partial download."""
    media = find_media(files, frame_rates(files), still_fps)
    check_end(files, media)
    return media


def clips_of(files: FileTree, media: Media, cutting: Cutting) -> tuple[Clip, ...]:
    """Read the clips of a video with known frames. SourceError when a file about it cannot be used."""
    notes: list[Note] = []
    keys, narrations, given = (_annotated if has_masks(files) else _bare)(files, media, notes)
    parts = cut_video(given, media, cutting)
    touched = [_overlapping(narrations, part) for part in parts]
    notes.extend(_unmatched(narrations, touched))
    about = _warnings_by_part(notes, parts)
    return tuple(
        _clip(files, part, f"_s{i:02d}" if len(parts) > 1 else "", media, keys, touched[i - 1], about[i - 1])
        for i, part in enumerate(parts, start=1))


def _annotated(files: FileTree, media: Media, notes: list[Note]) -> Found:
    keys = _present(read_keys(files, notes, media.names), media, notes)
    given = [key.frame for key in keys if not key.dense] or [key.frame for key in keys]
    return keys, video_narrations(files, media.frame_at, notes), given


def _bare(files: FileTree, media: Media, notes: list[Note]) -> Found:
    """Read a video without masks: any frame may become a key frame, and the default narration covers it."""
    first, last = int(media.numbers[0]), int(media.numbers[-1])
    notes.append((0, f"no masks of {files.name}; hands are looked for in its frames"))
    narrations = video_narrations(files, media.frame_at, notes, UNNAMED) or [default_narration(first, last)]
    return [], narrations, media.numbers.tolist()


def _present(keys: Sequence[KeyFrame], media: Media, notes: list[Note]) -> list[KeyFrame]:
    """Select the key frames whose frame exists. SourceError when an intact video ends well before them, or none is left."""
    numbers = set(media.numbers.tolist())
    kept = [key for key in keys if key.frame in numbers]
    lost = [key.frame for key in keys if key.frame not in numbers]
    has = f"frames {media.numbers[0]} to {media.numbers[-1]} of {media.names[0]}"
    if lost and media.kind == "video" and not media.truncated and lost[-1] > media.numbers[-1] + TAIL_SLACK_S * media.fps:
        raise SourceError(f"key frame {lost[-1]}", f"one of {has}", "an annotation outside the video",
                          "check that video and annotations belong together")
    if not kept:
        raise SourceError(media.names[0], "at least one annotated frame", f"{len(lost)} annotated frames, none of them present",
                          "check that frames and annotations belong together, and that every frame has masks")
    notes.extend((frame, f"frame {frame} is annotated but not among {has}; it was left out") for frame in lost)
    return kept


def _unmatched(narrations: Sequence[Narration], touched: Sequence[Sequence[Narration]]) -> list[Note]:
    """Remark on the narrations that overlap no clip."""
    matched = {n.narration_id for some in touched for n in some}
    missed = [n.narration_id for n in narrations if n.narration_id not in matched]
    if not missed:
        return []
    named = ", ".join(missed[:3]) + (", ..." if len(missed) > 3 else "")
    return [(0, f"{len(missed)} of {len(narrations)} narrations speak of no annotated part of the video: {named}")]


def _overlapping(narrations: Sequence[Narration], part: ClipRange) -> list[Narration]:
    return [n for n in narrations if n.start_frame <= part.last and n.stop_frame >= part.first]


def _warnings_by_part(notes: Sequence[Note], parts: Sequence[ClipRange]) -> list[tuple[str, ...]]:
    """Distribute remarks to parts: those on its frames, on frames nearest to it, and on the whole video."""
    lasts = [part.last for part in parts]

    def nearest(frame: int) -> int:
        after = bisect_left(lasts, frame)
        if after == len(parts) or (after and parts[after].first - frame >= frame - lasts[after - 1]):
            return after - 1
        return after

    found: list[dict[str, None]] = [{} for _ in parts]
    for frame, text in notes:
        for about in found if frame == 0 else [found[nearest(frame)]]:
            about[text] = None
    return [tuple(about) for about in found]


def _clip(
    files: FileTree, part: ClipRange, suffix: str, media: Media, keys: Sequence[KeyFrame], narrations: Sequence[Narration],
    warnings: tuple[str, ...],
) -> Clip:
    names, spans = media.names, media.spans
    if media.kind == "frames":
        inside = slice(int(np.searchsorted(media.numbers, part.first)), int(np.searchsorted(media.numbers, part.last, "right")))
        names, spans = names[inside], spans[inside]
    return Clip(
        clip_id=files.name + suffix, video_id=files.name, participant_id=_participant(files), split=_split(files), media=names,
        media_kind=media.kind, fps=media.fps, resample=media.resample, first_frame=part.first, last_frame=part.last,
        key_frames=tuple(keys[bisect_left(keys, part.first, key=_frame) : bisect_right(keys, part.last, key=_frame)]),
        narrations=tuple(narrations), warnings=warnings, spans=spans)


def _frame(key: KeyFrame) -> int:
    return key.frame


def _participant(files: FileTree) -> str:
    """Participant of the video: the prefix before the underscore for EPIC, else the video itself."""
    epic = any(file.name.startswith((SPARSE, DENSE)) or file.name in STANDARD for file in files.files)
    return files.name.split("_")[0] if epic else files.name


def _split(files: FileTree) -> str:
    """Split of the video by the folder of its annotations: train, val or test; '' for other folders."""
    folders = [part for file in files.files if file.name.endswith(".json") for part in PurePosixPath(file.name).parts[:-1]]
    return next((folder for folder in folders if folder in SPLITS), "")
