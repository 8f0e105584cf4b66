"""a prior, held-out clips of human motion -> tracking errors of the prior.

Reads   HandModel; GraspObjects; the ReferenceSet of held-out clips of these objects; the prior (FileTree of hand_imitation)
Writes  ClipsFollowed: errors of both levels of finger joints and of the fingertips, and success, of the prior, of motors that
        follow the clip exactly, and of a hand that does not move
Method  an episode of each clip from its start, the policy's mean action, strict physics; errors are means over fingers and steps;
        success: after 50/60 s the mean error of neither level is ever beyond the tolerance
Fails   ValueError: no clip, a clip of an unknown object, files of another policy
Paper   AffordDex, HTI: keypoints of two levels, failure beyond 15 cm. Here a hand that does not move is
        never so far off, hence the tolerance of 5 cm; no tracking error is published
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import ClipsFollowed
from schemas.files import FileTree
from schemas.grasp import GraspObject
from schemas.hand import HandModel, ReferenceSet
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "trimesh", "numba", "safetensors")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of imitation_evaluate."""

    engine: str = "bullet"
    """bullet or mujoco"""
    level: str = "train"
    """level of the objects (schemas/grasp.py LEVELS)"""
    iterations: int = 100
    """iterations of the physics solver"""
    rate_hz: int = 480
    """rate of the physics solver"""
    tolerance_m: float = 0.05
    """largest mean error of a level in a success"""
    at_once: int = 48
    """worlds simulated at once, at most"""
    places: int = 2
    """maps/grasping.py: held-out clips per object"""
    held_out: int = 7919
    """maps/grasping.py: offset of the seeds of grasp_targets and motion_synthesise for these clips"""
    seed: int = 20268
    """seed of object poses"""


def run(hand: HandModel, bodies: tuple[GraspObject, ...], references: ReferenceSet, prior: FileTree, params: Params,
        ctx: Context) -> ClipsFollowed:  # fmt: skip
    """Track every clip."""
    from afford.grasping.evaluate.tracking_error import TrackingParams, evaluate_tracking

    if params.at_once < 1 or params.iterations < 1 or not params.tolerance_m > 0:
        raise ValueError(f"imitation_evaluate: expected at_once and iterations of 1 or more and a tolerance_m above 0, got "
                         f"{params.at_once}, {params.iterations} and {params.tolerance_m}")
    tracking = TrackingParams(params.engine, params.level, params.iterations, params.rate_hz, params.tolerance_m, params.at_once,
                              params.seed)  # fmt: skip
    return evaluate_tracking(hand, bodies, references.references, prior, tracking, ctx.progress)
