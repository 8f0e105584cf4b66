"""Extract the footage of a clip: its media and frame range, so that changed narrations or outlines decode no frame again.

Reads   Clip
Writes  Footage: media, rate, first and last frame, numbers of the key frames
Method  a selection of fields; the frames depend on these and on the media alone
Fails   never
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.video import Clip, Footage

LIBRARIES = ()
THREADS = 1
MEMORY_GIB = 0.1


@dataclass(frozen=True)
class Params:
    """No parameters."""


def run(clip: Clip, params: Params) -> Footage:
    """Return the footage of a clip."""
    return Footage(clip.clip_id, clip.media, clip.media_kind, clip.fps, clip.resample, clip.first_frame, clip.last_frame,
                   tuple(key.frame for key in clip.key_frames), clip.spans)
