"""Object model of a scene: parts, an optional joint, and grips as palm frames.

Object frame: origin at the middle of the footprint, z up, resting on z = 0. The side that faces the person is -y. Long objects
extend along y, with the handle towards -y.

Palm frame (T_x_palm): origin at the centre of the palm's skin, x along the extended fingers, z out of the palm into the object,
y = z x x. The right thumb is at -y, the left thumb at +y.

Grip functions are written for the right hand. The grip of the left hand is the mirror image in the plane x = 0 (or `about_x`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from afford.render.mesh import Mesh
from afford.render.scene import Instance, Material
from schemas.video import OTHER


@dataclass(frozen=True, eq=False)
class Part:
    """Rigid piece of one material. `moving` parts follow the joint."""

    name: str
    mesh: Mesh
    material: Material
    moving: bool = False


@dataclass(frozen=True)
class Joint:
    """Joint of the moving parts.

    `kind` is hinge (value in radians about the axis), lift (metres along the axis) or free (a removable lid, posed by the
    script).
    """

    kind: str
    origin: tuple[float, float, float]
    axis: tuple[float, float, float]
    low: float
    high: float

    def T_obj_moving(self, value: float) -> np.ndarray:  # noqa: N802  # poses are named after their frames
        """Return the motion (4, 4) of the moving parts at `value`; identity at 0."""
        T = np.eye(4)
        axis = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        if self.kind != "hinge":
            T[:3, 3] = axis * value
            return T
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        T[:3, :3] = np.eye(3) + np.sin(value) * cross + (1 - np.cos(value)) * cross @ cross
        T[:3, 3] = np.asarray(self.origin) - T[:3, :3] @ np.asarray(self.origin)
        return T


@dataclass(frozen=True, eq=False)
class Grip:
    """One way to hold the object with one hand."""

    name: str
    """gripped part: body, handle, neck, rim, edge, lid ..."""
    kind: str
    """power_wrap, handle_wrap, pinch, flat_edge or top_grab"""
    side: str
    """left or right"""
    T_obj_palm: np.ndarray
    aperture_m: float
    """Thickness of the gripped part between thumb and fingers, metres."""
    moving: bool = False
    """True when the grip holds the moving part (a lid); T_obj_palm is then given at joint value 0."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """Object with its parts, joint and grips."""

    kind: str
    noun: str
    """EPIC noun, e.g. 'board:chopping'; a plain word outside the kitchen."""
    parts: tuple[Part, ...]
    grips: tuple[Grip, ...]
    joint: Joint | None = None
    spins: bool = False
    """True when the object is rotationally symmetric about z (apart from its texture), so that any yaw suits a grip."""
    opening: tuple[float, float, float] | None = None
    """Centre of the mouth (bottle, mug, pan, jar) for pouring and stirring, object frame."""
    tip: tuple[float, float, float] | None = None
    """Working point of a tool (blade, hammer face, spoon bowl), object frame."""

    @property
    def size(self) -> np.ndarray:
        """Extent (3,) in metres."""
        low = np.min([p.mesh.bounds[0] for p in self.parts], axis=0)
        return np.max([p.mesh.bounds[1] for p in self.parts], axis=0) - low

    @property
    def points(self) -> np.ndarray:
        """Vertices (v, 3) of all parts at rest, object frame."""
        return np.concatenate([p.mesh.vertices for p in self.parts])

    def instances(self, T_world_obj: np.ndarray, entity: int, opened: float = 0.0) -> list[Instance]:
        """Return the instances to draw, with the joint at `opened`."""
        swing = self.joint.T_obj_moving(opened) if self.joint else np.eye(4)
        return [Instance(p.mesh, p.material, T_world_obj @ swing if p.moving else T_world_obj, entity) for p in self.parts]

    def grips_of(self, side: str) -> tuple[Grip, ...]:
        """Return the grips of a side."""
        return tuple(grip for grip in self.grips if grip.side == side)


def palm_frame(position: ArrayLike, into: ArrayLike, fingers: ArrayLike) -> np.ndarray:
    """Return the palm frame (4, 4) at `position`, with z along `into` and x as close to `fingers` as possible."""
    z = np.asarray(into, float) / np.linalg.norm(into)
    x = np.asarray(fingers, float) - z * np.dot(z, fingers)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = position
    return T


PALM_GAP = 0.006
"""Height of the thumb's base above the palm's centre, metres."""
Vec = tuple[float, float, float]
LEFT, RIGHT, UP, AHEAD = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


def mirror_grip(grip: Grip, about_x: float = 0.0) -> Grip:
    """Mirror a grip in the plane x = `about_x` for the other hand."""
    flip = np.diag([-1.0, 1.0, 1.0])
    T = np.eye(4)
    T[:3, :3] = flip @ grip.T_obj_palm[:3, :3] @ np.diag([1.0, -1.0, 1.0])
    T[:3, 3] = flip @ grip.T_obj_palm[:3, 3] + [2 * about_x, 0, 0]
    return Grip(grip.name, grip.kind, OTHER[grip.side], T, grip.aperture_m, grip.moving)


def rod(
    name: str,
    centre: Vec,
    thumb: Vec,
    into: Vec,
    thickness: float,
    *,
    kind: str = "handle_wrap",
    lean_deg: float = 0.0,
    moving: bool = False,
) -> Grip:
    """Grip a rod through `centre` with the right hand, thumb towards `thumb`, palm pressed along `into`.

    `lean_deg` rotates the hand in the palm's plane so that the fingers point more towards the thumb's end (a slanted grip).
    """
    z = np.asarray(into, float) / np.linalg.norm(into)
    t = np.asarray(thumb, float) - z * (z @ np.asarray(thumb))
    t /= np.linalg.norm(t)
    fingers = np.cos(np.radians(lean_deg)) * np.cross(z, t) + np.sin(np.radians(lean_deg)) * t
    back = float(np.clip(thickness / 2 - 0.010, 0.012, 0.032))
    place = np.asarray(centre) - z * (thickness / 2 + PALM_GAP) - back * fingers
    return Grip(name, kind, "right", palm_frame(place, z, fingers), thickness, moving)


def with_mirror(grip: Grip, about_x: float = 0.0) -> tuple[Grip, Grip]:
    """Return a grip and its mirror image."""
    return grip, mirror_grip(grip, about_x)


def around(name: str, radius: float, height: float, *, lean_deg: float = 0.0) -> tuple[Grip, Grip]:
    """Grip an upright cylinder about z from the side, thumb up; `lean_deg` < 0 points the fingers downwards."""
    return with_mirror(rod(name, (0.0, 0.0, height), UP, LEFT, 2 * radius, kind="power_wrap", lean_deg=lean_deg))


def over(name: str, radius: float, top: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """Grip a lid or a low round object from above: palm down, fingers down on the far side, thumb on the near side."""
    at = np.array([0.010, -0.052, top + 0.026])
    frame = palm_frame(at, np.array([-0.10, 0.28, -0.95]), np.array([-0.25, 0.92, 0.28]))
    return with_mirror(Grip(name, "top_grab", "right", frame, 2 * radius, moving))


def along(name: str, at: Vec, thickness: float, *, tilt_deg: float = 40.0, lean_deg: float = 38.0) -> tuple[Grip, Grip]:
    """Grip a handle along y, thumb towards +y; `tilt_deg` is the elevation from which the palm approaches."""
    tilt = np.radians(tilt_deg)
    into = (-np.cos(tilt), 0.0, -np.sin(tilt))
    return with_mirror(rod(name, at, AHEAD, into, thickness, lean_deg=lean_deg), about_x=at[0])


def pinch(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """Pinch a thin object along y from above: fingertips on the far side, thumb on the near side."""
    frame = palm_frame(np.zeros(3), np.array([-0.42, 0.10, -0.90]), np.array([-0.50, 0.62, -0.45]))
    place = np.array(at) - frame[:3, :3] @ np.array([0.074, -0.014, 0.050])
    frame[:3, 3] = place
    return with_mirror(Grip(name, "pinch", "right", frame, thickness, moving), about_x=at[0])


def edge(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """Grip a flat rim from the right (for the right hand): thumb above, fingers beside and below."""
    centre = (at[0] - 0.012, at[1], at[2] - thickness / 2)
    grip = rod(name, centre, AHEAD, (-0.80, 0.0, -0.60), max(thickness, 0.012), kind="flat_edge", lean_deg=58.0, moving=moving)
    return with_mirror(grip)


def sides(name: str, half_width: float, height: float, *, back: float = 0.0, moving: bool = False) -> tuple[Grip, Grip]:
    """Press the palm on the side wall of a wide object, fingers forward, so that two hands carry it together."""
    frame = palm_frame(np.array([half_width + PALM_GAP, back - 0.03, height]), np.array(LEFT), np.array([0.0, 1.0, -0.12]))
    return with_mirror(Grip(name, "power_wrap", "right", frame, 2 * half_width, moving))
