"""A mesh file of any kind -> a surface, checked for what no repair can mend."""

from __future__ import annotations

import numpy as np

from afford.common.errors import SourceError
from afford.surface.meshes.files import MESH_SUFFIXES, URDF, main_file, suffix
from afford.surface.meshes.gltf import read_gltf
from afford.surface.meshes.obj import read_obj
from afford.surface.meshes.ply import read_ply, read_stl
from afford.surface.meshes.surface import Surface, check_corners
from afford.surface.meshes.urdf import read_urdf
from schemas.files import FileRef, FileTree

FARTHEST = 1e9
"""in any unit: squares and products of what is larger leave the range of numbers"""


def read_surface(files: FileTree) -> Surface:
    """The surface of one object in the unit of its file; SourceError names the file and what is wrong with it."""
    file = main_file(files)
    surface = read_urdf(files, file, read_mesh) if suffix(file.name) == URDF else read_mesh(files, file)
    if not len(surface.faces) or not len(surface.vertices):
        raise SourceError(file.name, "triangles", "none", "export the mesh again")
    check_corners(surface.faces, len(surface.vertices), file.name)
    for what, values in (("vertices", surface.vertices), ("texture coordinates", surface.uv.reshape(-1, 2))):
        broken = int((~np.isfinite(values)).any(axis=1).sum())
        if broken:
            raise SourceError(file.name, f"finite {what}", f"{broken} with NaN or infinity", "export the mesh again")
        if np.abs(values).max() > FARTHEST:
            raise SourceError(file.name, f"{what} of at most {FARTHEST:g}", f"{np.abs(values).max():g}", "export the mesh again")
    return surface


def read_mesh(files: FileTree, file: FileRef) -> Surface:
    """One mesh file by its ending."""
    ending = suffix(file.name)
    if ending == ".obj":
        return read_obj(files, file)
    if ending == ".ply":
        return read_ply(files, file)
    if ending == ".stl":
        return read_stl(files, file)
    if ending in (".glb", ".gltf"):
        return read_gltf(files, file)
    raise SourceError(file.name, f"a mesh ({', '.join(MESH_SUFFIXES)})", ending or "no ending", "convert it, e.g. to GLB")
