"""Default hand and task of the grasping environment: the Shadow Hand, and a hammer that is held by its handle."""

from __future__ import annotations

from functools import cache

from afford.grasping.env.task import Task, make_task
from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.mjcf import read
from afford.grasping.hand.model import Gantry, HandOptions, build_hand, couple_joints
from afford.grasping.sim.grasp_object import grasp_object
from afford.synthetic.objects.library import build_object
from schemas.hand import HandModel
from schemas.mesh import ObjectSpec

TOOL = ObjectSpec("hammer", "hammer", 11, "plain", "train")
HOLD = "handle"


@cache
def hand() -> HandModel:
    """The installed Shadow Hand on its gantry, as the stage hand_model builds it by default. SourceError if it is not installed."""
    gantry = Gantry(reach_m=2.0, force_n=200.0, torque_nm=30.0, mass_kg=0.05)
    return build_hand(couple_joints(read(shadow_files()), ()), HandOptions("", gantry))


@cache
def tool() -> Task:
    """Procedural hammer as the stage object_solids builds it by default; every part except the handle is negative."""
    made = build_object(TOOL, edge_m=0.006, max_faces=16_000, atlas_px=64)
    body = grasp_object(made.mesh, made.parts, density_kg_m3=700.0, tolerance_m=0.002, hulls=24, hull_corners=64, points=1024,
                        seed=0)  # fmt: skip
    return make_task(body, [part for part in body.parts if part != HOLD], HOLD)
