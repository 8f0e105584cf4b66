"""No texture: the one colour stays."""

from __future__ import annotations

from typing import Any

from schemas.mesh import ObjectMesh


def texture(mesh: ObjectMesh, params: Any) -> ObjectMesh:
    """The mesh itself; reads no parameter."""
    return mesh
