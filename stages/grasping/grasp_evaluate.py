"""a policy, tasks, a physics engine -> evaluation episodes with all figures, some of them step by step.

Reads   HandModel; GraspTasks of one level; the policy (FileTree of rl_grasp_refinement or grasp_student; empty: the base
        alone); human motion (ReferenceSet), with which likeness is measured
Writes  GraspEpisodes
Method  the policy's mean action, strict physics, the same starts for every policy; equally many episodes of each task
Fails   ValueError without tasks, or for a policy that does not fit the environment
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
    """Parameters of grasp_evaluate."""

    policy: str = "teacher"
    """name of the policy in tables"""
    engine: str = "bullet"
    """bullet or mujoco"""
    episodes: int = 200
    """least number of episodes, equally many of each task"""
    at_once: int = 48
    """worlds simulated at once, at most"""
    iterations: int = 100
    """iterations of the physics solver"""
    rate_hz: int = 480
    """rate of the physics solver"""
    poses: str = "flat"
    """flat, or dropped: objects are dropped in random orientations"""
    push_n: float = 0.0
    """force of random pushes on the raised object"""
    base: str = "script"
    """without a policy: the base that acts, script or none"""
    start: str = "anywhere"
    """without a policy: where the hand begins, part or anywhere"""
    traces: int = 6
    """episodes recorded step by step"""
    seed: int = 20267
    """seed of object poses and starts"""
    carry: bool = False
    """the wrist carries a gripped and raised object to its goal, and spare fingers near N_t let go, as in body_evaluate; false: the
    policy acts alone"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], policy: FileTree, references: ReferenceSet, params: Params,
        ctx: Context) -> GraspEpisodes:  # fmt: skip
    """Run all episodes."""
    from afford.grasping.evaluate.evaluate_policy import EvaluationParams, evaluate_policy

    mine = tuple(one for some in tasks for one in some)
    if not mine:
        raise ValueError("grasp_evaluate: no tasks; grasp_tasks lists the parts that can be held")
    wanted = EvaluationParams(params.policy, params.engine, params.episodes, params.at_once, params.iterations, params.rate_hz,
                         params.poses, params.push_n, params.base, params.start, params.traces,
                         params.seed, params.carry)  # fmt: skip
    return evaluate_policy(hand, mine, policy, references, wanted, ctx.progress)
