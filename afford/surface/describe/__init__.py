"""Interface of part description: parts that a hand must not touch for a task, and parts where it belongs."""

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
    """Backend of part_describe."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, task: str, params: Own) -> PartDescription:
        """Describe the parts of an object for a task.

        `mesh.category` is '' for an unknown category, `views` are its images, `task` is in words ('' for any use), and `params` are
        those of this backend. The result has category 'unknown' and no notes for an object that the backend does not know. Raises
        ValueError, one sentence, without a model or server, and for an output that violates the form.
        """
        ...
