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
        """Describe the parts of an object of `mesh.category` ('' where it is not known), rendered in `views`, for `task` in words
        ('' for any use). `params` are those of this backend.

        The result has category 'unknown' and no notes for an object that the backend does not know. ValueError, one sentence,
        when there is no model or no server, or when its output does not fit the form.
        """
        ...
