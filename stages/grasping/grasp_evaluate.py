"""a policy, tasks, a physics engine -> how it grasps: episodes with all their figures, some of them step by step.

Reads   HandModel; GraspTasks of one level; the policy (FileTree of rl_grasp_refinement or grasp_student, or none: the base
        alone); motions of people (ReferenceSet), which likeness is measured beside
Writes  GraspEpisodes
Method  the policy's mean action, strict physics, the same beginnings for every policy; each task as often as another
Fails   ValueError for no tasks, or a policy that does not fit
Paper   AffordDex: Succ, AS, HLS over randomly placed objects; our readings of them: docs/grasping/grasping.md
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel, ReferenceSet
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "trimesh", "numba", "pillow", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    policy: str = "teacher"
    """what the policy is called in tables"""
    engine: str = "bullet"
    """bullet or mujoco"""
    episodes: int = 200
    """at least so many, the same number of each task"""
    at_once: int = 48
    """most worlds at a time"""
    iterations: int = 100
    """of the solver"""
    rate_hz: int = 480
    """of the solver"""
    poses: str = "flat"
    """flat, or dropped: objects that fell at random"""
    push_n: float = 0.0
    """force of random pushes on the raised object"""
    base: str = "script"
    """where there is no policy: what acts instead, script or none"""
    start: str = "anywhere"
    """where there is no policy: where it begins, part or anywhere"""
    traces: int = 6
    """episodes that are kept step by step"""
    seed: int = 20267
    """of where objects lie and hands begin"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], policy: FileTree, references: ReferenceSet, params: Params,
        ctx: Context) -> GraspEpisodes:  # fmt: skip
    """Play all episodes."""
    from afford.grasping.evaluate.evaluate_policy import EvaluationParams, evaluate_policy

    mine = tuple(one for some in tasks for one in some)
    if not mine:
        raise ValueError("grasp_evaluate: no tasks; grasp_tasks lists the parts that can be held")
    wanted = EvaluationParams(params.policy, params.engine, params.episodes, params.at_once, params.iterations, params.rate_hz,
                         params.poses, params.push_n, params.base, params.start, params.traces,
                         params.seed)  # fmt: skip
    return evaluate_policy(hand, mine, policy, references, wanted, ctx.progress)
