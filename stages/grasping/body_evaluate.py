"""a policy, the tasks of one body, a physics engine -> evaluation episodes, some of them step by step.

Reads   HandModel; GraspTasks of one body (body_tasks); the policy (FileTree of rl_grasp_refinement or body_adapt)
Writes  GraspEpisodes; none for a body without a task
Method  as grasp_evaluate: the policy's mean action, strict physics, the same starts for every policy; but the hand begins over the
        place of the grasp family, the wrist carries what the policy has raised, while spare fingers let go of N_t, and human
        likeness is not measured
Fails   ValueError for a policy that does not fit the environment, or when the body does not rest in this engine
Paper   AffordDex: Succ and AS over randomly placed objects
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "gymnasium", "trimesh", "numba", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_evaluate."""

    policy: str = "teacher"
    """name of the policy in tables"""
    engine: str = "bullet"
    """bullet or mujoco"""
    episodes: int = 30
    """least number of episodes of a body, equally many of each of its tasks"""
    at_once: int = 10
    """worlds simulated at once, at most"""
    iterations: int = 100
    """iterations of the physics solver"""
    rate_hz: int = 480
    """rate of the physics solver"""
    traces: int = 1
    """tasks of a body with an episode that is recorded step by step"""
    seed: int = 20267
    """seed of object poses"""
    carry: bool = True
    """the wrist carries a gripped and raised body to its goal, and spare fingers near N_t let go (afford/grasping/env/carry.py,
    let_go.py); false: the policy acts alone"""


def run(hand: HandModel, tasks: tuple[GraspTask, ...], policy: FileTree, params: Params, ctx: Context) -> GraspEpisodes:
    """Run all episodes."""
    from afford.grasping.evaluate.evaluate_bodies import evaluate_body
    from afford.grasping.sim.scene import Physics

    if params.episodes < 1 or params.at_once < 1 or params.traces < 0:
        raise ValueError(f"body_evaluate: expected episodes and at_once of 1 or more and traces of 0 or more, got "
                         f"{params.episodes}, {params.at_once} and {params.traces}")
    return evaluate_body(params.policy, hand, tasks, policy, params.engine, params.episodes, params.at_once, params.traces,
                         Physics(iterations=params.iterations, rate_hz=params.rate_hz), params.seed, params.carry, ctx.progress)
