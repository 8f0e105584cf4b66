"""Read an RGB-D sequence: colours, depth, and the label of its last frame.

Reads   FileTree of one sequence in the layout of SOR3D-AFF, rendered or recorded (docs/rgbd/interaction-data.md)
Writes  InteractionClip; without depth files the depth is 0 everywhere
Method  the folder's name contains affordance and object; the affordance's colour in the mask is the label, the rest background
Fails   SourceError, one sentence: file, field, expected, got, what to do
Paper   SOR3D-AFF, section 6; its released code (STCAE) for layout, colours and the choice of frames
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import InteractionClip

LIBRARIES = ("numpy", "opencv-python-headless", "pillow")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `interaction_read`."""

    frames: str = "all"
    """all; or slots: ten frames, every second of 20 slots, black frames before short sequences (as in the released code)"""
    grid: str = "native"
    """native: pictures as they are; stcae: resized to 640 x 360, then rows 0 to 300 and columns 200 to 500 (as in the released
    code)"""
    rate_hz: float = 10.0
    """frames per second of files without a rate"""
    focal_px: float = 1081.4
    """focal length at a width of 1920 px of files without one: nominal for the colour camera of a Kinect 2"""


def run(files: FileTree, params: Params) -> InteractionClip:
    """Read one sequence."""
    from afford.rgbd.readers.sor3d import Rules, read_clip

    if params.frames not in ("all", "slots") or params.grid not in ("native", "stcae"):
        raise ValueError("interaction_read: expected frames 'all' or 'slots' and grid 'native' or 'stcae', "
                         f"got {params.frames!r} and {params.grid!r}")
    return read_clip(files, Rules(params.frames, params.grid, params.rate_hz, params.focal_px))
