"""Interface of texturing: give a mesh of one colour materials that show its parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from afford.common.registry import Own
from schemas.mesh import ObjectMesh


@dataclass(frozen=True)
class Procedural:
    """Parameters of `procedural`."""

    regions: int = 3
    """largest number of materials, 1..8"""
    side_px: int = 512
    """side of the texture, a power of two"""
    seed: int = 0
    """seed of the materials"""

    def __post_init__(self) -> None:
        if not 1 <= self.regions <= 8 or self.side_px < 64 or self.side_px & (self.side_px - 1):
            raise ValueError("expected 1 to 8 regions and side_px a power of two of 64 or more, got "
                             f"{self.regions} and {self.side_px}")


class Texture(Protocol[Own]):
    """Backend of mesh_texture."""

    def __call__(self, mesh: ObjectMesh, params: Own) -> ObjectMesh:
        """Return the mesh with another texture and other texture coordinates; vertices, faces and names stay.

        The mesh has one colour. `params` are those of this backend. Pure and deterministic; the input is not modified. Part labels
        are not an input.
        """
        ...
