"""Question: which parts of this thing must a hand not touch for this task, and where does it belong?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.chat import Chat, Endpoint

if TYPE_CHECKING:
    from schemas.mesh import ObjectMesh, ObjectViews
    from schemas.surface import PartDescription


@dataclass(frozen=True)
class Vlm(Chat):
    """Parameters of `vlm`."""

    views: int = 6
    """pictures of the object that are shown, on one sheet"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _shown(self.views)


@dataclass(frozen=True)
class Served(Endpoint):
    """Parameters of `endpoint`."""

    views: int = 6
    """pictures of the object that are shown, on one sheet"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _shown(self.views)


def _shown(views: int) -> None:
    if views < 1:
        raise ValueError(f"expected views of 1 or more, got {views}")


class Describer(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, task: str, params: Own) -> PartDescription:
        """Describe an object, said to be a `mesh.category` ('' when nobody said) and looking as `views` show it, for `task` in
        words ('' for any use). `params` are those of this backend.

        Category 'unknown' and no notes for what it does not know: a describer never guesses. ValueError in one sentence when no
        description can be had (no model, no server, an answer that is none).
        """
        ...
