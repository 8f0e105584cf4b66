"""Which files a mesh needs: what it names, and what those name."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

from afford.common.errors import SourceError
from afford.common.text import parse_json
from afford.surface.meshes import urdf
from afford.surface.meshes.files import MESH_SUFFIXES, URDF, suffix, target
from afford.surface.meshes.mtl import image_name, statements
from afford.surface.meshes.ply import HEADER_BYTES, texture_name

JSON_START = 20
"""bytes of a GLB before its JSON"""


def needs(name: str, path: Path) -> list[str]:
    """Root-relative names of what the file refers to, whether or not it exists. SourceError for what leaves the source."""
    kind = suffix(name)
    if kind == URDF:
        root = urdf.parse(_text(path), name)
        return [found for mesh in urdf.mesh_names(root, name, "visual") for found in urdf.candidates(name, mesh)]
    return [target(name, reference) for reference in _references(kind, path)]


def collisions(name: str, path: Path) -> list[str]:
    """Root-relative names of the collision meshes of a URDF."""
    root = urdf.parse(_text(path), name)
    return [found for mesh in urdf.mesh_names(root, name, "collision") for found in urdf.candidates(name, mesh)]


def _references(kind: str, path: Path) -> list[str]:
    if kind == ".obj":
        named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
        return [name.decode("utf-8", "replace") for name in named]
    if kind == ".mtl":
        return [image_name(rest, str(path.name)) for _, word, rest in statements(_text(path)) if word == "map_Kd"]
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
    """Whether a file is a mesh by its ending."""
    return suffix(name) in MESH_SUFFIXES
