"""The visible part is taken for the whole: the baseline that completion has to beat."""

from __future__ import annotations

from afford.extraction.complete import Completed
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """The mask of the tracks, with the tracks' confidence."""
    return Completed(tracks.masks[index], tracks.confidence[index])
