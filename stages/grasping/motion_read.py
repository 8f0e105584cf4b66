"""files of hand motion -> clips of one hand each, in metres, 21 keypoints in one order.

Reads   FileTree: .npz, .json, .csv of our own format (docs/grasping/motion-format.md); DexYCB's grasps as D-Grasp prepared them;
        OakInk2 after its import, with MANO as .npz
Writes  HandMotion of every clip
Method  units, orders of points and of quaternions are converted; nothing is smoothed, dropped or unpickled
Fails   SourceError that names file, field, expected and actual value, and what to do
Paper   AffordDex, HTI (human hand trajectories)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import HandMotion

LIBRARIES = ("numpy",)
BACKEND_LIBRARIES = {"dexycb": ("scipy",), "oakink2": ("scipy",)}
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {
    "keypoints": "afford.grasping.motion.keypoints:read",
    "dexycb": "afford.grasping.motion.dexycb:read",
    "oakink2": "afford.grasping.motion.oakink2:read",
}


@dataclass(frozen=True)
class Params:
    """Parameters of motion_read."""

    backend: str = "keypoints"
    """keypoints: our own format; dexycb: static grasps; oakink2: primitives of both hands, after motion/oakink2_import.py"""


def run(files: FileTree, params: Params) -> tuple[HandMotion, ...]:
    """Read all clips of a source. SourceError when two clips have the same name."""
    from afford.common.errors import SourceError
    from afford.common.registry import load

    found: tuple[HandMotion, ...] = load(BACKENDS, params.backend)(files)
    names = [motion.name for motion in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise SourceError(f"{files.name}, clip {twice!r}", "one file of that name", "two", "rename one")
    return found
