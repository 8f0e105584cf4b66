"""Question: how well does a mask in a view fit a part in words?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from schemas.files import FileTree
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartCandidates, PartDescriptions, PartScores


class Score(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
                 scorer: FileTree, params: Any) -> PartScores:  # fmt: skip
        """Scores of every candidate for every note of the descriptions, in order.

        `params` is the Params of the stage; a backend names the fields that it reads in its own docstring. Pure and
        deterministic; the inputs are not modified.
        """
        ...
