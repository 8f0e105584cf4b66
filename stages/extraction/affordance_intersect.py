"""Intersect complete objects with the hands that touch them: affordance masks of each hand, and the taxonomy of the task.

Reads   Tracks: hands, and the object that each hand touches; CompleteObjects
Writes  Affordances: left and right mask, 4-way and 3-way taxonomy, quality score, reason for rejection per frame
Method  intersection of the hand with the complete mask of the object it touches, then optional dilation; limits on the area
        are given at 855 x 855 as in the paper's code, and scaled to the working size
Fails   when the inputs are not of the same frames and size
Paper   2HandedAfforder, affordance extraction; dilation 10 x 10 and area below 20000 px at 855 x 855 there
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Affordances
from schemas.masks import CompleteObjects, Tracks

LIBRARIES = ("numpy", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `affordance_intersect`."""

    dilate_px855: float = 10.0
    """side of the square that dilates the masks, in pixels at 855 x 855 (the papers' 10); 0 leaves the intersection as it is"""
    min_area_px855: float = 20.0
    """a smaller affordance is rejected, in pixels at 855 x 855"""
    max_area_px855: float = 20000.0
    """a larger affordance is rejected, in pixels at 855 x 855"""
    min_quality: float = 0.05
    """a frame with a lower quality score is rejected, 0..1"""
    fade_frames: float = 60.0
    """distance to the key frame at which the confidence in a contact falls to one half"""


def run(tracks: Tracks, complete: CompleteObjects, params: Params) -> Affordances:
    """Compute one left and one right mask per frame. A rejected frame keeps its masks and gets a reason in `rejection`."""
    from afford.extraction import intersection as at

    _check(tracks, complete)
    objects = at.touched_objects(tracks, complete)
    masks = at.intersect(tracks, complete, objects)
    side = params.dilate_px855 * at.scale(masks)
    quality = at.quality(tracks, complete, objects, masks, params.fade_frames)
    limits = tuple(limit * at.scale(masks) ** 2 for limit in (params.min_area_px855, params.max_area_px855))
    masks = at.dilate_square(masks, round(side))
    return Affordances(
        clip_id=tracks.clip_id,
        objects=complete.entities,
        frame=tracks.frame,
        masks=masks,
        object_index=objects,
        taxonomy=at.taxonomy(objects),
        taxonomy3=at.taxonomy3(objects),
        quality=quality,
        rejection=at.rejection(tracks, complete, objects, masks, quality, limits, params.min_quality),
    )


def _check(tracks: Tracks, complete: CompleteObjects) -> None:
    found, wanted = complete.masks.shape[1:], tracks.masks.shape[1:]
    if found != wanted or complete.frame.tolist() != tracks.frame.tolist():
        raise ValueError(f"CompleteObjects of {tracks.clip_id}: expected masks of {wanted} as in Tracks, got {found}")
