"""Read the files of one object: repaired mesh in metres with one texture, part labels, and a report.

Reads   FileTree: OBJ (MTL, images), PLY, STL, GLB, glTF or URDF, and `<mesh file>.parts.json` (docs/surface/mesh-format.md)
Writes  ReadMesh: ObjectMesh, MeshParts, MeshReport; each is a separate artifact
Method  merge vertices, drop empty faces and dust, orient faces, fill small holes; pack images into one texture with unchanged
        texels; simplify meshes of more than max_faces by quadric edge collapse and bake their texture again from nearest points
Fails   SourceError, one sentence: file, expected, got, fix; other objects are not affected
Paper   AffordDex, NAA (its input is a mesh; the paper does not mention repair)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ReadMesh

LIBRARIES = ("numpy", "scipy", "trimesh", "pillow", "opencv-python-headless", "numba", "fast_simplification")
THREADS = 1
MEMORY_GIB = 3.0


@dataclass(frozen=True)
class Params:
    """Parameters of `mesh_read`."""

    unit: str = "auto"
    """m, cm, mm or inch; auto: the unit of the format (glTF, URDF: m), otherwise m, or the only unit that makes the diagonal 2 cm
    to 2 m
    """
    categories: tuple[str, ...] = ()
    """categories to find in the name of an object whose label file names none"""
    max_texture_px: int = 2048
    """longest side of the texture, a power of two; images are halved until they fit"""
    max_faces: int = 60_000
    """meshes with more faces are simplified"""
    hole_edges: int = 64
    """holes with more edges stay open"""
    hole_share: float = 0.01
    """holes with more than this share of the surface stay open"""
    dust_share: float = 0.0001
    """bodies with less than this share of the surface are dropped"""


def run(files: FileTree, params: Params) -> ReadMesh:
    """Read one object; ValueError when a parameter is out of range."""
    from afford.surface.meshes.mend import MeshSettings, read_repaired
    from afford.surface.meshes.repair import RepairLimits

    side = params.max_texture_px
    if params.max_faces < 100 or side < 64 or side & (side - 1):
        raise ValueError("mesh_read: expected max_faces of 100 or more and max_texture_px a power of two of 64 or more, got "
                         f"{params.max_faces} and {side}")
    limits = RepairLimits(params.hole_edges, params.hole_share, params.dust_share)
    return read_repaired(files, MeshSettings(params.unit, params.categories, side, params.max_faces, limits))
