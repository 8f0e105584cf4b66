"""What an object of a scene is: parts, a possible joint, and the ways to hold it.

Object frame: origin at the middle of the footprint, z up, resting on z = 0 as it lies or stands; the side that faces the
person is -y. Long things lie along y, handle towards -y.

Palm frame (T_x_palm): origin at the centre of the palm's skin, x along the stretched fingers, z out of the palm into the
object, y = z x x. The right thumb is at -y, the left thumb at +y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from afford.render.mesh import Mesh
from afford.render.scene import Instance, Material


@dataclass(frozen=True, eq=False)
class Part:
    """One rigid piece of one material. `moving` parts follow the joint."""

    name: str
    mesh: Mesh
    material: Material
    moving: bool = False


@dataclass(frozen=True)
class Joint:
    """How the moving parts move: `kind` is hinge (value in radians about axis), lift (metres along axis) or free (a lid that
    is taken off: the choreography gives its pose).
    """

    kind: str
    origin: tuple[float, float, float]
    axis: tuple[float, float, float]
    low: float
    high: float

    def T_obj_moving(self, value: float) -> np.ndarray:  # noqa: N802  # poses are named after their frames
        """(4, 4) motion of the moving parts at `value`; identity at 0."""
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
    """Where: body, handle, neck, rim, edge, lid ..."""
    kind: str
    """power_wrap, handle_wrap, pinch, flat_edge or top_grab."""
    side: str
    """left or right."""
    T_obj_palm: np.ndarray
    aperture_m: float
    """Thickness of what is held, between thumb and fingers."""
    moving: bool = False
    """Whether it holds the moving part (a lid): then T_obj_palm is at joint value 0."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """An object with its looks, its joint and its grips."""

    kind: str
    noun: str
    """EPIC noun, e.g. 'board:chopping'; a plain word outside the kitchen."""
    parts: tuple[Part, ...]
    grips: tuple[Grip, ...]
    joint: Joint | None = None
    spins: bool = False
    """True when the object looks the same turned about z (apart from its texture), so that any yaw suits a grip."""
    opening: tuple[float, float, float] | None = None
    """Centre of the mouth (bottle, mug, pan, jar) for pouring and stirring, object frame."""
    tip: tuple[float, float, float] | None = None
    """Working point of a tool (blade, hammer face, spoon bowl), object frame."""

    @property
    def size(self) -> np.ndarray:
        """(3,) extent in metres."""
        low = np.min([p.mesh.bounds[0] for p in self.parts], axis=0)
        return np.max([p.mesh.bounds[1] for p in self.parts], axis=0) - low

    @property
    def points(self) -> np.ndarray:
        """(v, 3) all vertices at rest, object frame."""
        return np.concatenate([p.mesh.vertices for p in self.parts])

    def instances(self, T_world_obj: np.ndarray, entity: int, opened: float = 0.0) -> list[Instance]:
        """The parts as they are drawn, with the joint at `opened`."""
        swing = self.joint.T_obj_moving(opened) if self.joint else np.eye(4)
        return [Instance(p.mesh, p.material, T_world_obj @ swing if p.moving else T_world_obj, entity) for p in self.parts]

    def grips_of(self, side: str) -> tuple[Grip, ...]:
        """The grips that this hand can take."""
        return tuple(grip for grip in self.grips if grip.side == side)


def palm_frame(position: ArrayLike, into: ArrayLike, fingers: ArrayLike) -> np.ndarray:
    """(4, 4) palm frame at `position` with z along `into` and x as near to `fingers` as it can be."""
    z = np.asarray(into, float) / np.linalg.norm(into)
    x = np.asarray(fingers, float) - z * np.dot(z, fingers)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = position
    return T
