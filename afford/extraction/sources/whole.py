"""Partial downloads: frames that should be there and are not, by the length that the source states. EPIC-KITCHENS-100."""

from __future__ import annotations

import math

from afford.common.errors import SourceError
from afford.extraction.sources.media import Media
from afford.extraction.sources.speech import INFO
from afford.extraction.sources.tables import read_table
from schemas.files import FileTree

END_SLACK_S = 2.0
"""frames may end this much earlier than the video: the tools that extract them disagree at the end of a file"""
DENSE_SHARE = 0.5
"""images that cover at least this share of the numbers up to the last are all frames of a video, not its key frames alone"""


def check_end(files: FileTree, media: Media) -> None:
    """SourceError when EPIC_100_video_info.csv says that the video goes on after the last image. Key frames alone pass, and video
    files, which tell themselves where they should end.
    """
    last = int(media.numbers[-1])
    if media.kind == "video" or len(media.numbers) < DENSE_SHARE * (last - int(media.numbers[0]) + 1):
        return
    length_s = _length_s(files)
    if length_s is not None and media.times_s[-1] < length_s - END_SLACK_S:
        wanted = f"frames to about {int(length_s * media.fps)} ({INFO}: {length_s:.1f} s at {media.fps:g} frames/s)"
        raise SourceError(media.names[0].rpartition("/")[0] or media.names[0], wanted, f"{len(media.numbers)} up to {last}",
                          "the download or the unpacking is not complete; finish it")


def _length_s(files: FileTree) -> float | None:
    info = files.find(INFO)
    for where, row in read_table(info.path.read_bytes(), INFO, ("video_id", "fps")) if info else ():
        if row["video_id"] == files.name and row.get("duration"):
            return _seconds(row["duration"], where)
    return None


def _seconds(text: str, where: str) -> float:
    try:
        length_s = float(text)
    except ValueError:
        length_s = math.nan
    if not math.isfinite(length_s):
        raise SourceError(f"{where}, column 'duration'", "seconds", repr(text), "correct the row")
    return length_s
