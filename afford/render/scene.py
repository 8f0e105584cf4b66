"""The nouns of the renderer: camera, light, material, instance and what comes out.

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
    """A pinhole. `K` (3, 3) px; `T_world_cam` (4, 4) maps camera to world, metres."""

    K: np.ndarray
    T_world_cam: np.ndarray
    width: int
    height: int


@dataclass(frozen=True)
class Light:
    """A key light with soft shadows, a soft ceiling light, and sky and ground ambience. Colours are linear RGB radiance."""

    direction: tuple[float, float, float] = (-0.45, 0.35, -0.8)
    """Travel direction of the key light in the world (from the lamp to the scene)."""
    colour: tuple[float, float, float] = (1.9, 1.75, 1.5)
    ceiling: tuple[float, float, float] = (0.5, 0.52, 0.58)
    """Radiance of the broad light from above."""
    sky: tuple[float, float, float] = (0.3, 0.31, 0.34)
    ground: tuple[float, float, float] = (0.14, 0.11, 0.09)
    softness: float = 0.09
    """Tangent of the key light's angular radius: penumbra width = softness x distance to the blocker."""
    centre: tuple[float, float, float] = (0.0, 0.35, 0.1)
    """Middle of the region that has shadows, world, metres."""
    radius_m: float = 0.85
    exposure: float = 1.0
    vignette: float = 0.12
    """Share of light lost in the corners of the image."""


@dataclass(frozen=True, eq=False)
class Material:
    """How a surface looks. `image` is (s, t, 3) uint8 sRGB, repeated over uv; it is compared by identity."""

    image: np.ndarray
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    specular: float = 0.04
    """Reflectance at normal incidence: 0.04 plastic and glaze, 0.6 metal."""
    roughness: float = 0.5
    bump: float = 0.0
    """Relief read out of the image's brightness; 0 is smooth."""
    metal: float = 0.0
    """1 when the reflection takes the colour of the image."""
    skin: float = 0.0
    """1 for light that wraps around and reddens, as in skin."""


@dataclass(frozen=True, eq=False)
class Instance:
    """A mesh put into the world."""

    mesh: Mesh
    material: Material
    T_world_mesh: np.ndarray = field(default_factory=lambda: np.eye(4))
    entity: int = BACKGROUND
    """Number in the id map; BACKGROUND for the room and clutter."""
    vertices: np.ndarray | None = None
    """(v, 3) world vertices of a skinned mesh, instead of T_world_mesh."""
    casts: bool = True
    """Whether it throws shadows (room surfaces do not)."""


@dataclass(frozen=True)
class Rendered:
    """An image with its exact maps. `ids` and `depth_m` are taken at pixel centres, never blended."""

    rgb: np.ndarray
    """(h, w, 3) uint8."""
    ids: np.ndarray
    """(h, w) int16: entity, BACKGROUND elsewhere."""
    depth_m: np.ndarray
    """(h, w) float32 along the optical axis, 0 where nothing is."""


@dataclass(frozen=True)
class Bundle:
    """Everything that is true of one frame."""

    rgb: np.ndarray
    rgb_no_hands: np.ndarray
    """Without hands and without their shadows, (h, w, 3) uint8."""
    rgb_no_hands_shadow: np.ndarray
    """Without hands, their shadows kept, (h, w, 3) uint8."""
    ids: np.ndarray
    depth_m: np.ndarray
    amodal: np.ndarray
    """(n, h, w) bool: entity n alone, as if nothing stood before it."""


GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class Textures:
    """A pool of mip-mapped images. `texels` (n, 3) uint8: 255 x the square root of linear RGB; `levels` (images, levels, 3)
    int64: offset, height, width of each level; `layer` finds an image by identity (the pool keeps the images alive).
    """

    texels: np.ndarray
    levels: np.ndarray
    layer: dict[int, int]
    images: tuple[np.ndarray, ...]

    @staticmethod
    def of(materials: Iterable[Material]) -> Textures:
        """The pool of the images that these materials use. ValueError when a side is not a power of two."""
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
    """(h, w, 3) uint8 sRGB to float32 linear 0..1."""
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
    """(v, 3) world vertices, normals, colours; (v, 2) uv; (f, 3) faces; (f,) part of each face; per part: entity int16,
    texture layer, and `looks` (tint rgb, specular, roughness, bump, metal, skin).
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
    """All instances as one."""
    placed = [_placed(i) for i in instances]
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


def _placed(instance: Instance) -> tuple[np.ndarray, np.ndarray]:
    """World vertices and normals of one instance, float32."""
    if instance.vertices is not None:
        points = np.ascontiguousarray(instance.vertices, np.float32)
        return points, smooth_normals(points, instance.mesh.faces)
    R = instance.T_world_mesh[:3, :3].astype(np.float32)
    return instance.mesh.vertices @ R.T + instance.T_world_mesh[:3, 3].astype(np.float32), instance.mesh.normals @ R.T
