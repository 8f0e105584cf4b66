"""mesh of one colour -> the same mesh with materials, so that its parts can be told apart in a picture.

Reads   ObjectMesh; nothing else: part labels are never seen
Writes  ObjectMesh: the same surface; one that has a texture passes unchanged, byte for byte
Method  `procedural` divides the surface by thickness, place along the main axis, curvature and creases, and gives each region a
        material; `keep` leaves the one colour
Fails   when a parameter is out of range
Paper   AffordDex, NAA (TexPainter, a diffusion model; not part of its released code)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectMesh

LIBRARIES = ("numpy", "scipy", "trimesh", "embreex", "opencv-python-headless", "numba")
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {
    "procedural": "afford.surface.texture.procedural:texture",
    "keep": "afford.surface.texture.keep:texture",
}


@dataclass(frozen=True)
class Params:
    backend: str = "procedural"
    """procedural or keep"""
    regions: int = 3
    """procedural: materials at most, 1..8"""
    side_px: int = 512
    """procedural: side of the texture, a power of two"""
    seed: int = 0
    """procedural: seed of the materials"""


def run(mesh: ObjectMesh, params: Params) -> ObjectMesh:
    """Texture what has no texture; ValueError when a parameter is out of range."""
    from afford.common.registry import load

    if not 1 <= params.regions <= 8 or params.side_px < 64 or params.side_px & (params.side_px - 1):
        raise ValueError("mesh_texture: expected 1 to 8 regions and side_px a power of two of 64 or more, got "
                         f"{params.regions} and {params.side_px}")
    texture = load(BACKENDS, params.backend)
    textured = (mesh.texture != mesh.texture[:1, :1]).any()
    return mesh if textured else texture(mesh, params)
