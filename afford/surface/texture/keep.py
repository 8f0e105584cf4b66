"""No texture: the one colour stays."""

from __future__ import annotations

from schemas.mesh import ObjectMesh


def texture(mesh: ObjectMesh, params: None) -> ObjectMesh:
    """The mesh itself."""
    return mesh
