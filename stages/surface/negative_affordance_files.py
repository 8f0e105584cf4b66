"""Export negative affordances as files for viewers and other programs.

Reads   ObjectMesh, PartDescriptions and NegativeAffordances of one object
Writes  for each task: surface.glb and surface.ply (red for negative faces), points.ply, N_t.ply, distance.npz (distance grid),
        negative.json (parts, roles, reasons, N_t)
Method  colours from green to red by probability; every face has its own corners, so that colours are exact
Fails   never
Paper   AffordDex, negative affordance: segmented.ply and description.txt
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectMesh
from schemas.spec import Context
from schemas.surface import NegativeAffordances, PartDescriptions

LIBRARIES = ("numpy", "trimesh", "opencv-python-headless", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """No parameters."""


def run(mesh: ObjectMesh, descriptions: PartDescriptions, found: NegativeAffordances, params: Params, ctx: Context) -> FileTree:
    """Write the files of one object."""
    from afford.surface.negative import export

    return export.write_files(mesh, descriptions, found, ctx.scratch)
