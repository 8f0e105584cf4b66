"""a source of recorded hand motion -> every motion that can be read, and a verdict on every recording that cannot.

Reads   FileTree: keypoints (.npz, .json, .csv), DexYCB's grasps as D-Grasp prepared them, or OakInk2 after its import
Writes  MotionsRead: HandMotions; verdicts of unusable recordings, one sentence each (gaps, values that are not finite, frames
        out of order, a name that two clips have)
Method  the readers of motion_read, one recording at a time; an unusable one does not affect the others
Fails   SourceError: no recording of this format, or none that can be used
Paper   AffordDex, HTI (human hand trajectories)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import MotionsRead

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of recordings_read."""

    format: str = "keypoints"
    """keypoints: our own format; dexycb: static grasps; oakink2: primitives of both hands, after motion/oakink2_import.py"""


def run(files: FileTree, params: Params) -> MotionsRead:
    """Read all recordings. ValueError for an unknown format."""
    from afford.grasping.motion.recordings import PARTS, read_recordings

    if params.format not in PARTS:
        raise ValueError(f"recordings_read, format: expected {', '.join(PARTS)}, got {params.format!r}")
    return read_recordings(files, params.format)
