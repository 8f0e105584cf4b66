"""A material for each region of the surface, found by its shape: thin things look like metal, thick ones like handles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from afford.surface.meshes.texture import texture as painted
from schemas.mesh import ObjectMesh


def texture(mesh: ObjectMesh, params: Any) -> ObjectMesh:
    """The mesh with materials; reads `regions`, `side_px` and `seed`."""
    uv, image = painted(mesh.vertices, mesh.faces, params.regions, params.side_px, params.seed)
    return replace(mesh, uv=uv, texture=image)
