"""Question: which pixels of a view may be one part of the object?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartCandidates


class Propose(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, params: Any) -> PartCandidates:
        """Masks of all views, by view and then by quality; several may overlap.

        `params` is the Params of the stage; a backend names the fields that it reads in its own docstring. Pure and
        deterministic; the inputs are not modified.
        """
        ...
