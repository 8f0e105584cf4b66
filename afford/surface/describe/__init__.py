"""Backends that describe which parts of an object a hand must not touch for a task, and where the hand belongs."""

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
    """number of pictures of the object, on one sheet"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _shown(self.views)


@dataclass(frozen=True)
class Served(Endpoint):
    """Parameters of `endpoint`."""

    views: int = 6
    """number of pictures of the object, on one sheet"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _shown(self.views)


def _shown(views: int) -> None:
    if views < 1:
        raise ValueError(f"expected views of 1 or more, got {views}")


class Describer(Protocol[Own]):
    """Signature of the backends that describe the parts of an object."""

    def __call__(self, mesh: ObjectMesh, views: ObjectViews, task: str, params: Own) -> PartDescription:
        """Describe the parts of an object for a task.

        `mesh.category` is '' where it is not known, `views` are renderings of the object, and `task` is '' for any use. The result
        has category 'unknown' and no notes for an object that the backend does not know. ValueError, one sentence, without a model
        or a server, or when an answer does not fit the form.
        """
        ...
