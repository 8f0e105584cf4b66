"""Drop key frames of a clip.

Reads   Clip
Writes  Clip with every n-th key frame, including the first
Method  used by the quality report to measure the effect of a wider gap between annotations
Fails   never
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from schemas.video import Clip

LIBRARIES: tuple[str, ...] = ()
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of `key_thin`."""

    stride: int = 2
    """keep every n-th key frame"""


def run(clip: Clip, params: Params) -> Clip:
    """Thin the key frames; ValueError when the stride is not positive."""
    if params.stride < 1:
        raise ValueError(f"key_thin.stride: expected at least 1, got {params.stride}")
    return replace(clip, key_frames=clip.key_frames[:: params.stride])
