"""Interface of part mask proposals: pixels of a view that may be one part of the object."""

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
    """largest IoU of two masks of a view; of two that overlap more, the better one is kept"""
    most: int = 20
    """largest number of masks of a view"""
    least_share: float = 0.004
    """smallest part, as a share of the object's area"""
    most_share: float = 0.95
    """largest part, as a share of the object's area and of its visible area in a view"""
    least_px: int = 60
    """smallest mask, pixels"""


@dataclass(frozen=True)
class Sam(Pretrained):
    """Parameters of `sam`."""

    model: str = ""
    """folder or hub id of a SamModel"""
    grid: int = 16
    """points along each side of a view; 32 in the released code"""
    least_iou: float = 0.88
    """smallest IoU that the model predicts for a mask"""
    least_stability: float = 0.7
    """smallest IoU of a mask thresholded slightly above and below"""
    offset: float = 0.7
    """offset of both thresholds of the stability score, logits"""
    nms_iou: float = 0.7
    """largest IoU of two masks of a view; of two that overlap more, the better one is kept"""
    most: int = 20
    """largest number of masks of a view"""
    most_share: float = 0.95
    """largest part, as a share of the visible area in a view"""
    least_px: int = 60
    """smallest mask, pixels"""
    batch: int = 64
    """points in one pass; 0.3 GB at the published sizes"""


@dataclass(frozen=True)
class Windows:
    """Parameters of `grid`."""

    windows: int = 6
    """windows along each side of the square around the silhouette; they overlap by half"""
    least_window: float = 0.02
    """smallest share of the visible object in a window"""


class Propose(Protocol[Own]):
    """Backend of mask_propose."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, params: Own) -> PartCandidates:
        """Propose masks of all views, sorted by view and then by quality; masks may overlap.

        `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
