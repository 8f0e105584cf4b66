"""Mask tracks of hands and objects: link entities, propagate, find contact."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tracking:
    """Parameters of tracks, however labels spread."""

    radius: int = 0
    """masks farther than this from their key frame are dropped, frames; 0 = full length (released code: 10)"""
    max_step_frames: int = 1
    """frames whose numbers differ by more are no neighbours: nothing is propagated between them"""
    keep_untouched: bool = False
    """also keep annotated objects that no hand touches in any key frame"""
    link_min_iou: float = 0.1
    """overlap from which a same-name object is the one of the key frame before"""
    contact_reach_px: int = 4
    """a hand dilated by this much touches what it overlaps; used where the source does not tell contact"""
