"""glTF and GLB reader, node by node in the order of the file.

trimesh is not used, because nodes must keep names and order (part labels refer to them), and because an unreadable image or
extension must be an error, not a grey mesh. Sparse accessors, compression and skins are refused.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote

import numpy as np
from trimesh.transformations import quaternion_matrix

from afford.common.errors import SourceError
from afford.common.text import parse_json
from afford.surface.meshes.surface import (
    PictureCache,
    Surface,
    check_triangles,
    decode_picture,
    find_reference,
    join_surfaces,
    transform_surface,
)
from schemas.files import FileRef, FileTree

MAGIC, JSON_CHUNK, BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
HANDLED = {"KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit"}
TRIANGLES = 4


@dataclass(frozen=True)
class _Document:
    files: FileTree
    file: FileRef
    tree: dict[str, Any]
    body: bytes
    """binary chunk of a GLB"""
    pictures: PictureCache = field(default_factory=PictureCache)
    _blobs: dict[str, bytes] = field(default_factory=dict)
    _images: dict[int, np.ndarray] = field(default_factory=dict)

    def refuse(self, expected: str, got: str) -> SourceError:
        return SourceError(self.file.name, expected, got, "export it as GLB with plain triangles and PNG or JPEG images")

    def blob(self, uri: str | None) -> bytes:
        """Return the bytes of a uri, read once, or the binary chunk."""
        if uri is None:
            return self.body
        if uri not in self._blobs:
            self._blobs[uri] = (base64.b64decode(uri.partition(",")[2]) if uri.startswith("data:")
                                else find_reference(self.files, self.file.name, unquote(uri)).path.read_bytes())  # fmt: skip
        return self._blobs[uri]

    def view(self, index: int) -> tuple[memoryview, int]:
        """Return the bytes of a buffer view, and its stride (0: packed)."""
        view = self.tree["bufferViews"][index]
        data = self.blob(self.tree["buffers"][view["buffer"]].get("uri"))
        start = view.get("byteOffset", 0)
        if start + view["byteLength"] > len(data):
            raise self.refuse(f"{start + view['byteLength']} bytes in buffer {view['buffer']}", f"{len(data)}")
        return memoryview(data)[start : start + view["byteLength"]], view.get("byteStride", 0)

    def array(self, index: int) -> np.ndarray:
        """Return the values (n, width) of an accessor; normalised integers as 0..1."""
        accessor = self.tree["accessors"][index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self.refuse("plain accessors", f"accessor {index} that is sparse or empty")
        data, stride = self.view(accessor["bufferView"])
        kind, width, count = np.dtype(KINDS[accessor["componentType"]]), WIDTHS[accessor["type"]], accessor["count"]
        step, start = stride or kind.itemsize * width, accessor.get("byteOffset", 0)
        if count and start + (count - 1) * step + kind.itemsize * width > len(data):
            raise self.refuse(f"{count} values in accessor {index}", "a shorter buffer")
        out = np.ndarray((count, width), kind, data, start, (step, kind.itemsize))
        return out / np.iinfo(kind).max if accessor.get("normalized") else out

    def image(self, texture: int) -> np.ndarray:
        """Return a texture image (h, w, 3) uint8, decoded once."""
        source = self.tree["textures"][texture].get("source")
        if source is None:
            raise self.refuse("PNG or JPEG images", f"texture {texture} in another format")
        if source not in self._images:
            image = self.tree["images"][source]
            data = bytes(self.view(image["bufferView"])[0]) if "bufferView" in image else self.blob(image.get("uri"))
            self._images[source] = decode_picture(data, f"{self.file.name}, image {source}")
            self.pictures.count(self._images[source], self.file.name)
        return self._images[source]

    def corners(self, primitive: dict[str, Any]) -> int:
        """Return the larger of the stated numbers of corners and vertices of a primitive."""
        places = primitive["attributes"]["POSITION"]
        return max(int(self.tree["accessors"][index]["count"]) for index in (places, primitive.get("indices", places)))


def read_gltf(files: FileTree, file: FileRef) -> Surface:
    """Read a surface in metres; the group of a face is the name of its node."""
    data = file.path.read_bytes()
    document = _Document(files, file, *_chunks(data, file.name))
    try:
        found = _primitives(document)
    except SourceError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise document.refuse("a complete glTF 2.0 document", f"{type(error).__name__} {error}") from error
    if not found:
        raise document.refuse("triangles", "an empty scene")
    return join_surfaces(found, "m")


def _primitives(document: _Document) -> list[Surface]:
    """Read every triangle primitive of the scene, after a check of their total size."""
    unknown = sorted(set(document.tree.get("extensionsRequired", [])) - HANDLED)
    if unknown:
        raise document.refuse(f"no required extensions but {', '.join(sorted(HANDLED))}", ", ".join(unknown))
    meshes = document.tree.get("meshes", [])
    wanted = [(primitive, name, T) for name, T, mesh in _nodes(document) for primitive in meshes[mesh]["primitives"]
              if primitive.get("mode", TRIANGLES) >= TRIANGLES]  # fmt: skip
    check_triangles(sum(document.corners(primitive) for primitive, _, _ in wanted) // 3, document.file.name)
    materials = _materials(document)
    return [_primitive(document, primitive, name, T, materials) for primitive, name, T in wanted]


def _chunks(data: bytes, name: str) -> tuple[dict[str, Any], bytes]:
    """Split a file into JSON tree and binary chunk."""
    if len(data) < 12 or struct.unpack_from("<I", data)[0] != MAGIC:
        tree, body = parse_json(data, name), b""
    else:
        parts: dict[int, bytes] = {}
        at = 12
        while at + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, at)
            parts.setdefault(kind, data[at + 8 : at + 8 + length])
            at += 8 + length
        if JSON_CHUNK not in parts:
            raise SourceError(name, "a JSON chunk", "another chunk", "was the file cut short? get it again")
        tree, body = parse_json(parts[JSON_CHUNK], name), parts.get(BIN_CHUNK, b"")
    asset = tree.get("asset") if isinstance(tree, dict) else None
    if not isinstance(asset, dict) or not str(asset.get("version", "")).startswith("2"):
        raise SourceError(name, "glTF 2.x", "another version or none", "export it as glTF 2.0")
    return tree, body


def _nodes(document: _Document) -> Iterator[tuple[str, np.ndarray, int]]:
    """List name, pose and mesh of every mesh node of the scene, parents first."""
    tree = document.tree
    carried = {child for node in tree.get("nodes", []) for child in node.get("children", [])}
    free = [index for index in range(len(tree.get("nodes", []))) if index not in carried]
    roots = tree["scenes"][tree.get("scene", 0)].get("nodes", []) if tree.get("scenes") else free
    stack = [(index, np.eye(4)) for index in reversed(list(roots))]
    seen: set[int] = set()
    while stack:
        index, parent = stack.pop()
        node = tree["nodes"][index]
        if index in seen:
            raise document.refuse("nodes that form a tree", f"node {node.get('name', index)!r} in two places")
        seen.add(index)
        T = parent @ _local(node)
        if "skin" in node:
            raise document.refuse("rigid meshes", f"the skinned node {node.get('name', index)!r}")
        if "mesh" in node:
            yield node.get("name", f"node_{index}"), T, node["mesh"]
        stack.extend((child, T) for child in reversed(node.get("children", [])))


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    T = quaternion_matrix([w, x, y, z]) @ np.diag([*node.get("scale", (1, 1, 1)), 1.0])
    T[:3, 3] = node.get("translation", (0, 0, 0))
    return T


def _materials(document: _Document) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return image and (3, 3) uv transform of each material; the image is multiplied by the base colour."""
    out = []
    for material in document.tree.get("materials", []):
        base = material.get("pbrMetallicRoughness", {})
        factor = np.array(base.get("baseColorFactor", (1, 1, 1, 1)), np.float64)[:3]
        texture = base.get("baseColorTexture")
        image = document.image(texture["index"]) if texture else np.full((1, 1, 3), 255, np.uint8)
        if texture and texture.get("texCoord", 0) != 0:
            raise document.refuse("base colours on the first set of texture coordinates", f"set {texture['texCoord']}")
        if not (factor == 1).all():
            image = _tinted(image, factor)
            document.pictures.count(image, document.file.name)
        out.append((image, _shift(texture or {})))
    return out


def _tinted(image: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Multiply (h, w, 3) uint8 sRGB by a linear (3,) factor, with a table of the 256 values."""
    table = srgb(linear(np.arange(256, dtype=np.uint8))[:, None] * factor)
    return np.stack([table[image[..., channel], channel] for channel in range(3)], axis=-1)


def _shift(texture: dict[str, Any]) -> np.ndarray:
    given = texture.get("extensions", {}).get("KHR_texture_transform", {})
    angle, (sx, sy), (ox, oy) = given.get("rotation", 0.0), given.get("scale", (1, 1)), given.get("offset", (0, 0))
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy], [0, 0, 1]])


def _primitive(document: _Document, primitive: dict[str, Any], name: str, T: np.ndarray,
               materials: list[tuple[np.ndarray, np.ndarray]]) -> Surface:
    """Read one primitive; SourceError for strips, fans and compression."""
    if primitive.get("mode", TRIANGLES) != TRIANGLES:
        raise document.refuse("plain triangles", f"a primitive of mode {primitive['mode']}")
    attributes = primitive["attributes"]
    vertices = document.array(attributes["POSITION"]).astype(np.float64)
    index = document.array(primitive["indices"])[:, 0].astype(np.int64) if "indices" in primitive else np.arange(len(vertices))
    faces = index.reshape(-1, 3)
    if faces.size and faces.max() >= len(vertices):
        raise document.refuse(f"vertex indices below {len(vertices)}", str(faces.max()))
    image, shift = materials[primitive["material"]] if "material" in primitive else (np.full((1, 1, 3), 255, np.uint8), np.eye(3))
    uv, count, notes = np.zeros((len(vertices), 2)), len(faces), []
    if "TEXCOORD_0" in attributes:
        uv = document.array(attributes["TEXCOORD_0"]) @ shift[:2, :2].T + shift[:2, 2]
        uv[:, 1] = 1 - uv[:, 1]
    elif image.size > 3:
        notes.append(("faces without texture coordinates under an image", count))
    paint, colour = np.zeros(count, np.int64), np.zeros((count, 3, 3), np.uint8)
    if "COLOR_0" in attributes and image.size == 3:
        shade = linear(image)[0, 0] * document.array(attributes["COLOR_0"])[:, :3]
        paint, colour = np.full(count, -1), srgb(shade)[faces]
    elif "COLOR_0" in attributes:
        notes.append(("faces whose vertex colours were left out beside an image", count))
    flat = Surface(vertices, faces, uv[faces], paint, (image,), colour, np.arange(count), np.zeros(count, np.int64), (name,),
                   tuple(notes))  # fmt: skip
    return transform_surface(flat, T)


def linear(image: np.ndarray) -> np.ndarray:
    """Convert uint8 sRGB to linear 0..1."""
    value = np.asarray(image, np.float64) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def srgb(value: np.ndarray) -> np.ndarray:
    """Convert linear 0..1 to uint8 sRGB."""
    value = np.clip(value, 0, 1)
    return np.round(np.where(value <= 0.0031308, value * 12.92, 1.055 * value ** (1 / 2.4) - 0.055) * 255).astype(np.uint8)
