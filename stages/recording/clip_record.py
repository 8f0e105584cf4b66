"""Merge the recordings of a clip's stages into one recording, in time order.

Reads   Clip; one FileTree of one .mcap file per stage (stage_record)
Writes  FileTree of one file, <clip>.mcap, with every topic and every metadata record of its parts
Method  a merge by (log time, topic); payloads are copied unchanged, every chunk checked against its CRC
Fails   when two parts use one topic, or one schema name with two definitions, or a part is damaged
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context
from schemas.video import Clip

LIBRARIES = ("numpy", "mcap", "zstandard", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `clip_record`: none."""


def run(clip: Clip, parts: tuple[FileTree, ...], params: Params, ctx: Context) -> FileTree:
    """Merge the recordings of one clip; ValueError names the topic, schema or part at fault."""
    from afford.recording.mcap_files import as_tree, merge_recordings
    from afford.recording.provenance import of_clip

    path = ctx.scratch / f"{clip.clip_id}.mcap"
    merge_recordings([file.path for part in parts for file in part.files], path, of_clip(clip))
    return as_tree(clip.clip_id, path)
