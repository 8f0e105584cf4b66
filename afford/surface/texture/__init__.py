"""Question: what is a mesh of one colour made of?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from schemas.mesh import ObjectMesh


class Texture(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, mesh: ObjectMesh, params: Any) -> ObjectMesh:
        """The mesh with another texture and other texture coordinates; vertices, faces and names stay as they are.

        The mesh has one colour. `params` is the Params of the stage; a backend names the fields that it reads in its own
        docstring. Pure and deterministic; the input is not modified. It never sees part labels.
        """
        ...
