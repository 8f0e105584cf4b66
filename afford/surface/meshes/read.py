"""Read a mesh file of any format as a checked surface, and list the files that it refers to."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from afford.common.errors import SourceError
from afford.common.text import parse_json
from afford.surface.meshes import urdf
from afford.surface.meshes.gltf import read_gltf
from afford.surface.meshes.obj import image_name, mtl_statements, read_obj
from afford.surface.meshes.ply import HEADER_BYTES, read_ply, read_stl, texture_name
from afford.surface.meshes.surface import MESH_SUFFIXES, URDF, Surface, check_corners, main_file, resolve_reference, suffix
from afford.surface.meshes.urdf import read_urdf
from schemas.files import FileRef, FileTree

FARTHEST = 1e9
"""largest coordinate in any unit; squares and products of larger ones overflow"""


def read_surface(files: FileTree) -> Surface:
    """Read the surface of one object in the unit of its file; SourceError gives the file and the fault."""
    file = main_file(files)
    surface = read_urdf(files, file, read_mesh) if suffix(file.name) == URDF else read_mesh(files, file)
    if not len(surface.faces) or not len(surface.vertices):
        raise SourceError(file.name, "triangles", "an empty mesh", "export the mesh again")
    check_corners(surface.faces, len(surface.vertices), file.name)
    for what, values in (("vertices", surface.vertices), ("texture coordinates", surface.uv.reshape(-1, 2))):
        broken = int((~np.isfinite(values)).any(axis=1).sum())
        if broken:
            raise SourceError(file.name, f"finite {what}", f"{broken} with NaN or infinity", "export the mesh again")
        if np.abs(values).max() > FARTHEST:
            raise SourceError(file.name, f"{what} of at most {FARTHEST:g}", f"{np.abs(values).max():g}", "export the mesh again")
    return surface


def read_mesh(files: FileTree, file: FileRef) -> Surface:
    """Read one mesh file by its suffix."""
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


JSON_START = 20
"""offset of the JSON chunk in a GLB"""


def referenced_files(name: str, path: Path) -> list[str]:
    """List the root-relative names of referenced files, existing or not. SourceError for a name outside the source."""
    kind = suffix(name)
    if kind == URDF:
        root = urdf.parse(_text(path), name)
        return [found for mesh in urdf.mesh_names(root, name, "visual") for found in urdf.candidates(name, mesh)]
    return [resolve_reference(name, reference) for reference in _references(kind, path)]


def collision_meshes(name: str, path: Path) -> list[str]:
    """List the root-relative names of the collision meshes of a URDF."""
    root = urdf.parse(_text(path), name)
    return [found for mesh in urdf.mesh_names(root, name, "collision") for found in urdf.candidates(name, mesh)]


def _references(kind: str, path: Path) -> list[str]:
    if kind == ".obj":
        named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
        return [name.decode("utf-8", "replace") for name in named]
    if kind == ".mtl":
        return [image_name(rest, str(path.name)) for _, word, rest in mtl_statements(_text(path)) if word == "map_Kd"]
    if kind == ".ply":
        with path.open("rb") as stream:
            header = stream.read(HEADER_BYTES).partition(b"end_header")[0].decode("latin-1")
        return [found] if (found := texture_name(header)) else []
    if kind in (".gltf", ".glb"):
        return _uris(kind, path)
    return []


def _uris(kind: str, path: Path) -> list[str]:
    data = path.read_bytes()
    if kind == ".glb":
        data = data[JSON_START : JSON_START + int.from_bytes(data[12:16], "little")]
    tree = parse_json(data, path.name)
    try:
        entries = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [entry["uri"] for entry in entries if "uri" in entry]
        return [unquote(uri) for uri in uris if not uri.startswith("data:")]
    except (ValueError, AttributeError, TypeError) as error:
        raise SourceError(path.name, "a glTF document", str(error), "export it again") from error


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8-sig", "replace")


def is_mesh(name: str) -> bool:
    """Return True for the suffix of a mesh file."""
    return suffix(name) in MESH_SUFFIXES
