"""Read clips of actions, frames and action labels, for pre-training.

Reads   FileTree of UTKinect-Action3D (docs/rgbd/interaction-data.md)
Writes  ActionClip of every action of every sequence
Method  frames are spread evenly over an action; a clip has depth when every frame has it
Fails   SourceError, one sentence: file, field, expected, got, what to do
Paper   SOR3D-AFF, section 6 (the RGB-D encoder is pre-trained on UTKinect)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import ActionClip

LIBRARIES = ("numpy", "opencv-python-headless", "pillow")
THREADS = 1
MEMORY_GIB = 2.0


@dataclass(frozen=True)
class Params:
    """Parameters of `action_read`."""

    size_px: int = 112
    """side to which pictures are resized"""
    frames: int = 10
    """maximum number of frames of an action"""


def run(files: FileTree, params: Params) -> tuple[ActionClip, ...]:
    """Read all actions."""
    from afford.rgbd.readers.utkinect import read_actions

    if params.size_px < 8 or params.frames < 1:
        raise ValueError(f"action_read: expected size_px of 8 or more and frames of 1 or more, got {params}")
    return read_actions(files, params.size_px, params.frames)
