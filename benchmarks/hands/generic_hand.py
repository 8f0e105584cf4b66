"""Generic hand of the WebXR input profiles (npm `@webxr-input-profiles/assets`, MIT): a skinned glTF mesh with 25 joints."""

from __future__ import annotations

import json
import struct
import subprocess
import tarfile
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.hands.body_model import creases, subdivided
from benchmarks.hands.skinned_hand import BONES, SkinnedHand, aligned, rest_pads

PACKAGE = "@webxr-input-profiles/assets@1.0.20"
MEMBER = "package/dist/profiles/generic-hand/right.glb"
THUMB = ("thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip")
FINGER = ("phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
KEYPOINTS = ("wrist", *THUMB, *(f"{digit}-finger-{part}" for digit in ("index", "middle", "ring", "pinky") for part in FINGER))
TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def fetched(cache: Path) -> Path:
    """Return the npm archive in the cache folder, fetched where it is missing."""
    found = sorted(cache.glob("webxr-input-profiles-assets-*.tgz"))
    if not found:
        subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=cache, check=True, stdout=subprocess.DEVNULL)
        found = sorted(cache.glob("webxr-input-profiles-assets-*.tgz"))
    return found[0]


def generic_hand(archive: Path) -> SkinnedHand:
    """Build the right hand, which ends at the wrist."""
    with tarfile.open(archive) as file:
        member = file.extractfile(MEMBER)
        if member is None:
            raise FileNotFoundError(f"{archive.name}: {MEMBER} is not in it; fetch {PACKAGE}")
        data = member.read()
    size = struct.unpack("<I", data[12:16])[0]
    scene, blob = json.loads(data[20 : 20 + size]), data[28 + size :]
    mesh = scene["meshes"][0]["primitives"][0]
    read = {name: _array(scene, blob, number) for name, number in mesh["attributes"].items()}
    faces = _array(scene, blob, mesh["indices"]).reshape(-1, 3).astype(int)
    skin = scene["skins"][0]
    names = [scene["nodes"][n]["name"] for n in skin["joints"]]
    bind = _array(scene, blob, skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    places = {name: np.linalg.inv(M)[:3, 3] for name, M in zip(names, bind, strict=True)}
    keypoints = np.array([places[name] for name in KEYPOINTS])
    T = aligned(keypoints)
    keypoints = keypoints @ T[:3, :3].T + T[:3, 3]
    points, weights = _welded(read["POSITION"] @ T[:3, :3].T + T[:3, 3], _weights(read, names), faces)
    points, faces, weights = subdivided(*points, weights)
    weights = weights / weights.sum(1, keepdims=True)
    deep = creases(points, trimesh.Trimesh(points, faces, process=False).vertex_normals)
    colour = np.exp(-1.5 * deep[:, None] * np.array([3.0, 4.2, 4.2]))
    return SkinnedHand(points, faces, weights, keypoints, rest_pads(keypoints), colour)


def _array(scene: dict, blob: bytes, number: int) -> np.ndarray:  # type: ignore[type-arg]  # JSON
    """Read an accessor without interleaving."""
    accessor = scene["accessors"][number]
    view = scene["bufferViews"][accessor["bufferView"]]
    kind, width = TYPES[accessor["componentType"]], WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride, row = view.get("byteStride", 0), width * np.dtype(kind).itemsize
    if stride and stride != row:
        raw = np.frombuffer(blob, np.uint8, accessor["count"] * stride, start).reshape(-1, stride)[:, :row]
        return np.ascontiguousarray(raw).view(kind).reshape(-1, width)
    return np.frombuffer(blob, kind, accessor["count"] * width, start).reshape(-1, width)


def _weights(read: dict[str, np.ndarray], names: list[str]) -> np.ndarray:
    """Add up joint weights by the bones of the rendered hands: (v, 17)."""
    bones = {KEYPOINTS[1 + 4 * d + k]: 2 + 3 * d + min(k, 2) for d in range(5) for k in range(4)}
    column = np.array([bones.get(name, 1) for name in names])
    out = np.zeros((len(read["POSITION"]), BONES))
    for k in range(4):
        np.add.at(out, (np.arange(len(out)), column[read["JOINTS_0"][:, k]]), read["WEIGHTS_0"][:, k])
    return out


def _welded(points: np.ndarray, weights: np.ndarray, faces: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Join vertices at the same place, which texture seams had split."""
    _, first, place = np.unique(np.round(points * 1e6).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    joined = place.reshape(-1)[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 0] != joined[:, 2])
    return (points[first], joined[whole]), weights[first]
