"""mesh of one colour -> the same mesh with materials, so that its parts can be told apart in a picture.

Reads   ObjectMesh; nothing else: part labels are never seen
Writes  ObjectMesh: the same surface; one that has a texture passes unchanged, byte for byte
Method  `procedural` divides the surface by thickness, place along the main axis, curvature and creases, and gives each region a
        material; `keep` leaves the one colour
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
    "keep": "afford.surface.texture:keep",
}


@dataclass(frozen=True)
class Params:
    backend: str = "procedural"
    """procedural or keep"""
    procedural: Procedural = Procedural()
    """parameters of procedural"""


def run(mesh: ObjectMesh, params: Params) -> ObjectMesh:
    """Texture what has no texture."""
    from afford.common.registry import block, load

    texture = load(BACKENDS, params.backend)
    textured = (mesh.texture != mesh.texture[:1, :1]).any()
    return mesh if textured else texture(mesh, block(params, params.backend))
