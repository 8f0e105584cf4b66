"""The nouns of the renderer: camera, light, material, instance and what comes out.

World axes: z up, metres. Camera axes: x right, y down, z forward. Pixel (x, y) has its centre at integer coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from afford.render.mesh import Mesh

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
