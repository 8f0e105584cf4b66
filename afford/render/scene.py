"""Scene types of the renderer: camera, light, material, instance, texture pool, batch, and its results.

World axes: z up, metres. Camera axes: x right, y down, z forward. Pixel (x, y) has its centre at integer coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from afford.render.mesh import Mesh, smooth_normals

BACKGROUND = -1


@dataclass(frozen=True)
class Camera:
    """Pinhole camera; `K` (3, 3) px, `T_world_cam` (4, 4) maps camera to world, metres."""

    K: np.ndarray
    T_world_cam: np.ndarray
    width: int
    height: int


@dataclass(frozen=True)
class Light:
    """Key light with soft shadows, soft ceiling light, ambience of sky and ground; linear RGB radiance."""

    direction: tuple[float, float, float] = (-0.45, 0.35, -0.8)
    """travel direction of the key light in the world (from the lamp to the scene)"""
    colour: tuple[float, float, float] = (1.9, 1.75, 1.5)
    ceiling: tuple[float, float, float] = (0.5, 0.52, 0.58)
    """radiance of the broad light from above"""
    sky: tuple[float, float, float] = (0.3, 0.31, 0.34)
    ground: tuple[float, float, float] = (0.14, 0.11, 0.09)
    softness: float = 0.09
    """tangent of the key light's angular radius: penumbra width = softness x distance to the blocker"""
    centre: tuple[float, float, float] = (0.0, 0.35, 0.1)
    """centre of the region with shadows, world, metres"""
    radius_m: float = 0.85
    exposure: float = 1.0
    vignette: float = 0.12
    """share of light lost in the corners of the image"""


@dataclass(frozen=True, eq=False)
class Material:
    """Surface material; `image` is (s, t, 3) uint8 sRGB, repeated over uv, and compared by identity."""

    image: np.ndarray
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    specular: float = 0.04
    """reflectance at normal incidence: 0.04 plastic and glaze, 0.6 metal"""
    roughness: float = 0.5
    bump: float = 0.0
    """relief from the brightness of the image; 0 is smooth"""
    metal: float = 0.0
    """1 for a reflection in the colour of the image"""
    skin: float = 0.0
    """1 for wrapped, reddened light, as on skin"""


@dataclass(frozen=True, eq=False)
class Instance:
    """Mesh with a material and a pose in the world."""

    mesh: Mesh
    material: Material
    T_world_mesh: np.ndarray = field(default_factory=lambda: np.eye(4))
    entity: int = BACKGROUND
    """number in the id map; BACKGROUND for the room and clutter"""
    vertices: np.ndarray | None = None
    """(v, 3) world vertices of a skinned mesh, instead of T_world_mesh."""
    casts: bool = True
    """True for an instance that casts shadows (room surfaces do not)"""


@dataclass(frozen=True)
class Rendered:
    """Image with exact maps; `ids` and `depth_m` are taken at pixel centres and never blended."""

    rgb: np.ndarray
    """(h, w, 3) uint8"""
    ids: np.ndarray
    """(h, w) int16: entity, BACKGROUND elsewhere"""
    depth_m: np.ndarray
    """(h, w) float32 along the optical axis, 0 for the background"""


@dataclass(frozen=True)
class Bundle:
    """Ground truth of one frame."""

    rgb: np.ndarray
    rgb_no_hands: np.ndarray
    """without hands and without their shadows, (h, w, 3) uint8"""
    rgb_no_hands_shadow: np.ndarray
    """without hands, with their shadows, (h, w, 3) uint8"""
    ids: np.ndarray
    depth_m: np.ndarray
    amodal: np.ndarray
    """(n, h, w) bool: entity n alone, without occluders"""


GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class Textures:
    """Pool of mip-mapped images in one flat array, so that one kernel can read any of them.

    `texels` (n, 3) uint8 is 255 x the square root of linear RGB. `levels` (images, levels, 3) int64 has offset, height and width of
    each level. `layer` maps the identity of an image to its index; the pool keeps the images alive.
    """

    texels: np.ndarray
    levels: np.ndarray
    layer: dict[int, int]
    images: tuple[np.ndarray, ...]

    @staticmethod
    def of(materials: Iterable[Material]) -> Textures:
        """Build the pool of the images of these materials. ValueError for a side that is not a power of two."""
        unique = {id(m.image): m.image for m in materials}
        for image in unique.values():
            if any(side & (side - 1) for side in image.shape[:2]):
                raise ValueError(f"Material.image: expected sides that are powers of two, got {image.shape[:2]}; resize it")
        images = tuple(unique.values())
        pyramids = [_pyramid(image) for image in images]
        depth = max(len(p) for p in pyramids)
        levels = np.zeros((len(images), depth, 3), np.int64)
        offset = 0
        for row, pyramid in zip(levels, pyramids, strict=True):
            for k in range(depth):
                level = pyramid[min(k, len(pyramid) - 1)]
                row[k] = (offset if k < len(pyramid) else row[k - 1, 0], *level.shape[:2])
                offset += level.shape[0] * level.shape[1] if k < len(pyramid) else 0
        texels = np.concatenate([_roots(level).reshape(-1, 3) for pyramid in pyramids for level in pyramid])
        return Textures(texels, levels, {key: k for k, key in enumerate(unique)}, images)


def linear(image: np.ndarray) -> np.ndarray:
    """Convert (h, w, 3) uint8 sRGB to float32 linear 0..1."""
    return ((np.arange(256) / 255.0) ** GAMMA).astype(np.float32)[image]


def _roots(level: np.ndarray) -> np.ndarray:
    return (np.sqrt(level) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _pyramid(image: np.ndarray) -> list[np.ndarray]:
    level = linear(image)
    out = [level]
    while min(level.shape[:2]) > 1:
        h, w = level.shape[0] // 2 * 2, level.shape[1] // 2 * 2
        level = level[:h, :w].reshape(h // 2, 2, w // 2, 2, 3).mean(axis=(1, 3), dtype=np.float32)
        out.append(np.ascontiguousarray(level))
    return out


@dataclass(frozen=True, eq=False)
class Batch:
    """Instances flattened into world-space triangles with a table of materials, as the kernels read them.

    (v, 3) world vertices, normals, colours; (v, 2) uv; (f, 3) faces; (f,) part of each face. For each part: entity int16, texture
    layer, and `looks` (tint rgb, specular, roughness, bump, metal, skin).
    """

    vertices: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    part: np.ndarray
    entity: np.ndarray
    layer: np.ndarray
    looks: np.ndarray
    casts: np.ndarray


def batch(instances: Sequence[Instance], textures: Textures) -> Batch:
    """Flatten instances into one batch."""
    placed = [world_vertices(i) for i in instances]
    starts = np.cumsum([0] + [len(v) for v, _ in placed[:-1]])
    faces = [i.mesh.faces + np.int32(s) for i, s in zip(instances, starts, strict=True)]
    materials = [i.material for i in instances]
    return Batch(
        np.concatenate([v for v, _ in placed]),
        np.concatenate([n for _, n in placed]),
        np.concatenate([i.mesh.colour for i in instances]),
        np.concatenate([i.mesh.uv for i in instances]),
        np.concatenate(faces),
        np.repeat(np.arange(len(faces), dtype=np.int32), [len(f) for f in faces]),
        np.array([i.entity for i in instances], np.int16),
        np.array([textures.layer[id(m.image)] for m in materials], np.int32),
        np.array([(*m.tint, m.specular, m.roughness, m.bump, m.metal, m.skin) for m in materials], np.float32),
        np.array([i.casts for i in instances], np.bool_),
    )


def world_vertices(instance: Instance) -> tuple[np.ndarray, np.ndarray]:
    """Transform the vertices and normals of one instance to the world, float32."""
    if instance.vertices is not None:
        points = np.ascontiguousarray(instance.vertices, np.float32)
        return points, smooth_normals(points, instance.mesh.faces)
    R = instance.T_world_mesh[:3, :3].astype(np.float32)
    return instance.mesh.vertices @ R.T + instance.T_world_mesh[:3, 3].astype(np.float32), instance.mesh.normals @ R.T
