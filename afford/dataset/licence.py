"""The licence of a data set: what its videos allow, and never more."""

from __future__ import annotations

from collections.abc import Iterable

from afford.common.video.probe import EPIC_ID

EPIC = "cc-by-nc-4.0"
UNKNOWN = "other"
"""the Hub's word for a licence that is written out"""
NOTES = {
    EPIC: "Whatever is derived from EPIC-KITCHENS or VISOR is under CC BY-NC 4.0, as they are: "
          "name the authors, no commercial use.",
    UNKNOWN: "The videos say what may be done with it: whatever holds for them and for their annotations holds for this data set. "
             "Ask who made them before you pass it on.",
    "apache-2.0": "Every picture was rendered by afford, from shapes and textures of its own; "
                  "nothing was taken from another data set.",
}  # fmt: skip


def licence_of(videos: Iterable[str], stated: str) -> str:
    """Licence id for a data set made of these videos; `stated` may be '' when nobody said anything.

    ValueError when a video of EPIC-KITCHENS (P01 to P37) is among them and another licence than EPIC's is stated.
    """
    epic = next((video for video in sorted(videos) if EPIC_ID.fullmatch(video)), "")
    if epic and stated not in ("", EPIC):
        raise ValueError(f"license: expected {EPIC}, because {epic} is of EPIC-KITCHENS, got {stated!r}; leave it out, or rename "
                         "the video if it is your own")
    return EPIC if epic else stated or UNKNOWN
