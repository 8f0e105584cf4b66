"""files of a robot hand -> the hand model: links, joints, fingers, and a URDF that physics engines read.

Reads   FileTree: the Shadow Hand's MJCF and meshes as installed with gymnasium-robotics, or one URDF with its meshes
Writes  HandModel: joints (6 of the wrist's gantry, motors, coupled), fingertips and keypoints, palm axes, URDF, meshes
Method  `shadow` converts MuJoCo's compiled model; `urdf` reads any hand with joint limits, and finds fingers by the names of links.
        The hand is cut at the palm (or above it) and mounted on three slides and three hinges; passive joints follow their driver
        (<mimic>)
Fails   SourceError: a missing mesh, limit, mass or finger; joints in a cycle
Paper   AffordDex: Shadow Hand, 24 actions = 6 of the wrist + 18 motors; 22 finger joints, 4 of them coupled
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.grasping.hand import Urdf
from schemas.files import FileTree
from schemas.hand import HandModel

LIBRARIES = ("numpy", "scipy", "trimesh", "opencv-python-headless")
BACKEND_LIBRARIES = {"shadow": ("mujoco",), "urdf": ("pillow",)}
THREADS = 1
MEMORY_GIB = 0.5

BACKENDS = {
    "shadow": "afford.grasping.hand.mjcf:read",
    "urdf": "afford.grasping.hand.read_urdf:read",
}


@dataclass(frozen=True)
class Params:
    """Parameters of hand_model."""

    backend: str = "shadow"
    """shadow: the files of gymnasium-robotics; urdf: any hand"""
    root: str = ""
    """root link of the hand, e.g. forearm; '' = the palm, the last link that carries all fingers"""
    wrist: str = "gantry"
    """gantry: a 6-DoF wrist carries the root; none: the root is free"""
    reach_m: float = 2.0
    """gantry: travel of the slides, both ways"""
    wrist_force_n: float = 200.0
    """gantry: largest force of a slide"""
    wrist_torque_nm: float = 30.0
    """gantry: largest torque of a hinge"""
    gantry_mass_kg: float = 0.05
    """gantry: mass of each of its six parts"""
    capsules: str = "capsule"
    """capsule: one solid, an extension that PyBullet and MuJoCo read; parts: a cylinder and two spheres, standard URDF"""
    urdf: Urdf = Urdf()
    """parameters of urdf"""


def run(files: FileTree, params: Params) -> HandModel:
    """Build the hand. ValueError for a wrong parameter or source."""
    from afford.common.registry import block, load
    from afford.grasping.hand.model import Gantry, HandOptions, build_hand, couple_joints

    _check(params)
    gantry = Gantry(params.reach_m, params.wrist_force_n, params.wrist_torque_nm, params.gantry_mass_kg)
    own = block(params, params.backend)
    fingers, pairs = (own.fingers, own.coupled) if own else ((), ())
    options = HandOptions(params.root, gantry if params.wrist == "gantry" else None, params.capsules == "capsule", fingers)
    return build_hand(couple_joints(load(BACKENDS, params.backend)(files), pairs), options)


def _check(params: Params) -> None:
    for name, allowed in (("wrist", ("gantry", "none")), ("capsules", ("capsule", "parts"))):
        if getattr(params, name) not in allowed:
            raise ValueError(f"hand_model, {name}: expected {' or '.join(allowed)}, got {getattr(params, name)!r}")
    positive = ("reach_m", "wrist_force_n", "wrist_torque_nm", "gantry_mass_kg")
    wrong = next((name for name in positive if getattr(params, name) <= 0), None)
    if wrong:
        raise ValueError(f"hand_model, {wrong}: expected a number above zero, got {getattr(params, wrong)}")
