"""Objects that a hand can grasp in a physics engine: convex pieces of named parts, mass and inertia, points of the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class GraspObject(Schema):
    """A rigid body, in the frame of its mesh: z up, resting on z = 0. Hull k has the corners hull_start[k] to hull_start[k + 1]."""

    name: str = value("id of the object")
    category: str = value("what it is, e.g. knife; '' when nobody said")
    parts: tuple[str, ...] = value("p part names, e.g. handle, blade; faces that nobody named are the part `unnamed`")
    corners: np.ndarray = array("v 3", "float64", "corners of all convex hulls, one hull after another", unit="m", frame="object")
    hull_start: np.ndarray = array("*", "int32", "h + 1 numbers: where each hull begins in `corners`, and their end")
    hull_part: np.ndarray = array("h", "int16", "index into `parts` of each hull; a hull lies in one part")
    mass_kg: float = value("volume of the closed mesh times its density", unit="kg")
    com_m: np.ndarray = array("3", "float64", "centre of mass", unit="m", frame="object")
    inertia_kgm2: np.ndarray = array("3 3", "float64", "inertia about the centre of mass", unit="kg m^2", frame="object")
    closed: bool = value("whether the mesh is closed; if not, mass and inertia are those of its hulls")
    points: np.ndarray = array("n 3", "float32", "points of the surface, even by area", unit="m", frame="object")
    normals: np.ndarray = array("n 3", "float32", "unit normals of the surface there, outwards", frame="object")
    point_part: np.ndarray = array("n", "int16", "index into `parts` of each point")
    size_m: np.ndarray = array("3", "float64", "extent along x, y, z", unit="m", frame="object")
    stand_out_m: np.ndarray = array("h", "float64", "how far each hull stands out of the mesh (95th percentile)", unit="m")

    def hulls(self) -> tuple[np.ndarray, ...]:
        """The (k, 3) corners of each hull."""
        ends = zip(self.hull_start[:-1], self.hull_start[1:], strict=True)
        return tuple(self.corners[first:last] for first, last in ends)
