"""Question: which pixels of a view may be one part of the object?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartCandidates


@dataclass(frozen=True)
class Regions:
    """Parameters of `regions`."""

    nms_iou: float = 0.7
    """of two masks of a view that overlap more, the better one is kept"""
    most: int = 20
    """masks of a view"""
    least_share: float = 0.004
    """of the object's area, for a part"""
    most_share: float = 0.95
    """of the object's area and of what a view shows of it, for a part"""
    least_px: int = 60
    """pixels of a mask"""


@dataclass(frozen=True)
class Sam(Pretrained):
    """Parameters of `sam`."""

    model: str = ""
    """folder or hub id of a SamModel"""
    grid: int = 16
    """points along each side of a view; 32 in the released code"""
    least_iou: float = 0.88
    """IoU that the model predicts for a mask"""
    least_stability: float = 0.7
    """IoU of a mask cut a little above and below its threshold"""
    offset: float = 0.7
    """how far above and below the threshold a mask is cut to see whether it is stable, logits"""
    nms_iou: float = 0.7
    """of two masks of a view that overlap more, the better one is kept"""
    most: int = 20
    """masks of a view"""
    most_share: float = 0.95
    """of what a view shows of the object, for a part"""
    least_px: int = 60
    """pixels of a mask"""
    batch: int = 64
    """points in one pass; 0.3 GB at the published sizes"""


@dataclass(frozen=True)
class Windows:
    """Parameters of `grid`."""

    windows: int = 6
    """windows along each side of the square around the silhouette; they overlap by half"""
    least_window: float = 0.02
    """of what a view shows of the object, in a window"""


class Propose(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, params: Own) -> PartCandidates:
        """Masks of all views, by view and then by quality; several may overlap.

        `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
