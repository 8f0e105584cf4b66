"""Small scenes for tests of physics."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh

from afford.grasping.hand.kinematics import commanded_columns, moving_joints
from afford.grasping.sim.scene import Physics, Scene
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectSpec
from stages.grasping import object_solids
from stages.synthetic import object_build
from tests.helpers.made_hands import shadow
from tests.helpers.made_meshes import as_object
from tests.helpers.read_only import read_only

FEW = object_solids.Params(points=128)


@cache
def tool(category: str = "screwdriver", seed: int = 3) -> GraspObject:
    """A procedural object."""
    built = object_build.run(ObjectSpec(category, category, seed, "plain", "train"), object_build.Params(atlas_px=64))
    return read_only(object_solids.run(built.mesh, built.parts, FEW))


@cache
def block() -> GraspObject:
    """A box of 6 x 3 x 10 cm that stands on z = 0, its lower and its upper half a part each."""
    lower = trimesh.creation.box((0.06, 0.03, 0.10))
    mesh = as_object(lower.apply_translation((0, 0, 0.05)).subdivide(), "block")
    middle = mesh.vertices[mesh.faces][:, :, 2].mean(axis=1)
    return read_only(object_solids.run(mesh, MeshParts("block", ("foot", "top"), (middle > 0.05).astype(np.int16)), FEW))


def scene(body: GraspObject | None = None, **physics: float) -> Scene:
    """The Shadow Hand and an object; physics by field."""
    return Scene(shadow(), body or block(), Physics(**physics))  # type: ignore[arg-type]  # fields of Physics


def away() -> np.ndarray:
    """(28,) joints of a hand half a metre above the table and aside."""
    q = np.zeros(len(moving_joints(shadow().joints)))
    q[[1, 2]] = 0.5
    return q


def commands(q: np.ndarray) -> np.ndarray:
    """(24,) the motors' share of joints."""
    joints = shadow().joints
    found: np.ndarray = q[commanded_columns(joints)]
    return found


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(7,) an upright pose."""
    return np.array([x, y, z, 0.0, 0.0, 0.0, 1.0])
