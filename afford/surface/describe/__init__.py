"""Question: which parts of this thing must a hand not touch for this task, and where does it belong?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartDescription


class Describer(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, task: str, params: Any) -> PartDescription:
        """Describe an object, said to be a `mesh.category` ('' when nobody said) and looking as `views` show it, for `task` in
        words ('' for any use).

        Category 'unknown' and no notes for what it does not know: a describer never guesses. ValueError in one sentence when no
        description can be had (no model, no server, an answer that is none).
        """
        ...
