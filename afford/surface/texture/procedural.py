"""A material for each region of the surface, found by its shape: thin things look like metal, thick ones like handles."""

from __future__ import annotations

from dataclasses import replace

from afford.surface.meshes.texture import paint_regions as painted
from afford.surface.texture import Procedural
from schemas.mesh import ObjectMesh


def texture(mesh: ObjectMesh, params: Procedural) -> ObjectMesh:
    """The mesh with materials."""
    uv, image = painted(mesh.vertices, mesh.faces, params.regions, params.side_px, params.seed)
    return replace(mesh, uv=uv, texture=image)
