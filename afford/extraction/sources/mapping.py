"""VISOR's frame numbers as EPIC's released frames have them (frame_mapping.json). VISOR, frame extraction.

The table is needed only where released frames are used, and then it must be there: masks that are drawn on a frame of another
number are wrong without looking wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from afford.common.errors import SourceError
from afford.common.text import parse_json, word_tables
from afford.common.video.probe import epic_rate, parse_frame_number
from afford.extraction.sources.discover import DENSE, FRAME_MAPPING, SPARSE
from schemas.files import FileTree

RELEASED = "frame_"
"""how EPIC's own frames are called; VISOR's begin with the video's id"""


def read_mapping(files: FileTree, frames: Sequence[str]) -> Mapping[str, str]:
    """VISOR's image names -> those of EPIC's released frames, empty where `frames` (names of the media) are others.

    SourceError when the table is needed and missing, malformed, or silent about the video.
    """
    if not any(PurePosixPath(name).name.startswith(RELEASED) for name in frames):
        return {}
    table, needed = files.find(FRAME_MAPPING), epic_rate(files.name) is not None and _by_visor(files)
    if table is None and not needed:
        return {}
    if table is None:
        raise SourceError(FRAME_MAPPING, f"VISOR's table of frame numbers, because {frames[0]} is one of EPIC's released frames, "
                          "which are numbered otherwise", "nothing", "put it beside the tables (`python pipeline.py fetch-list` "
                          "says where it is), or use the video itself")
    found = word_tables(parse_json(table.path.read_bytes(), FRAME_MAPPING), FRAME_MAPPING)
    if needed and files.name not in found:
        raise SourceError(FRAME_MAPPING, f"an entry for {files.name}", f"{len(found)} other videos", "get the file again")
    return found.get(files.name, {})


def released(image: Mapping[str, Any], name: str, mapped: Mapping[str, str]) -> int | None:
    """The released frame that an image of VISOR shows; None when the table does not say. A dense image is as far from its place
    as the sparse ones between which it was interpolated.
    """
    if name in mapped:
        return parse_frame_number(mapped[name])
    ends = [str(image.get(f"interpolation_{end}_frame", "")).replace(".png", ".jpg") for end in ("start", "end")]
    shifts = {_shift(end, mapped[end]) for end in ends if end in mapped}
    number = parse_frame_number(name)
    return number + shifts.pop() if number is not None and len(shifts) == 1 and set(ends) <= mapped.keys() else None


def _shift(ours: str, theirs: str) -> int:
    return (parse_frame_number(theirs) or 0) - (parse_frame_number(ours) or 0)


def _by_visor(files: FileTree) -> bool:
    return any(file.name.startswith((SPARSE, DENSE)) for file in files.files)
