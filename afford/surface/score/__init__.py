"""Interface of part scorers: fit between a mask in a view and a part in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    from schemas.files import FileTree
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartCandidates, PartDescriptions, PartScores


@dataclass(frozen=True)
class Clip(Pretrained):
    """Parameters of `clip`."""

    model: str = ""
    """folder of save_pretrained with its tokenizer.json, or a folder with it as clip/; or a hub id"""
    least_cosine: float = -1.0
    """smallest best cosine of a candidate; below it the candidate fits no part; -1 for none"""
    batch: int = 32
    """candidates in one pass; 0.6 GB at the published size"""


class Score(Protocol[Own]):
    """Backend of mask_score."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
                 scorer: FileTree, params: Own) -> PartScores:  # fmt: skip
        """Score every candidate for every note of the descriptions, in order.

        `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
