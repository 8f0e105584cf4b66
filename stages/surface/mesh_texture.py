"""Texture a mesh of one colour, so that its parts can be distinguished in an image.

Reads   ObjectMesh; part labels are not an input
Writes  ObjectMesh: the same surface; a mesh with a texture is returned unchanged, byte for byte
Method  `procedural` segments the surface by thickness, position along the main axis, curvature and creases, and gives each region
        a material; `keep` keeps the one colour
Fails   when the backend is unknown
Paper   AffordDex, NAA (TexPainter, a diffusion model; not part of its released code)
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.surface.texture import Procedural
from schemas.mesh import ObjectMesh

LIBRARIES = ("numpy",)
BACKEND_LIBRARIES = {"procedural": ("scipy", "trimesh", "embreex", "opencv-python-headless", "numba")}
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {
    "procedural": "afford.surface.texture.procedural:texture",
    "keep": "afford.surface.texture.procedural:keep",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `mesh_texture`."""

    backend: str = "procedural"
    """procedural or keep"""
    procedural: Procedural = Procedural()
    """parameters of procedural"""


def run(mesh: ObjectMesh, params: Params) -> ObjectMesh:
    """Texture a mesh of one colour."""
    from afford.common.registry import block, load

    texture = load(BACKENDS, params.backend)
    textured = (mesh.texture != mesh.texture[:1, :1]).any()
    return mesh if textured else texture(mesh, block(params, params.backend))
