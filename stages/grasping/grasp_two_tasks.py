"""objects, a policy -> two tasks per object: the place of the grasp with N_t at one end of the object, and at the other.

Reads   HandModel; GraspObjects; the policy (FileTree of rl_grasp_refinement or grasp_student)
Writes  TwoTasksShown: TwoTasks of all pairs, and a sheet of both grasps of the object whose grasp moved farthest
Method  each object from the same pose and start with N_t at either end (100 points more than 2 cm from the centre of mass); the
        policy's mean action, strict physics; position of the palm along the object at the end
Fails   ValueError without objects, or for one that does not reach 2 cm to both sides
Paper   AffordDex conditions its policy on N_t; the figure of its effect on the place of the grasp is ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import TwoTasksShown
from schemas.files import FileTree
from schemas.grasp import GraspObject
from schemas.hand import HandModel
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "trimesh", "numba", "pillow", "opencv-python-headless",
             "matplotlib", "safetensors", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_two_tasks."""

    policy: str = "teacher"
    """name of the policy in tables"""
    engine: str = "bullet"
    """bullet or mujoco"""
    rounds: int = 2
    """pairs of episodes of each object"""
    at_once: int = 24
    """objects simulated at once, at most, two worlds each"""
    iterations: int = 100
    """iterations of the physics solver"""
    rate_hz: int = 480
    """rate of the physics solver"""
    shown: int = 1
    """objects on the sheet"""
    width: int = 320
    """width of its images, px"""
    height: int = 240
    """height of its images, px"""
    supersample: int = 2
    """samples per pixel along each axis"""
    seed: int = 20269
    """seed of object poses and starts"""


def run(hand: HandModel, bodies: tuple[GraspObject, ...], policy: FileTree, params: Params, ctx: Context) -> TwoTasksShown:
    """Grasp every object twice, and draw the sheet."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.env.rendering import GraspRenderer
    from afford.grasping.evaluate.grasp_sheet import write_sheet
    from afford.grasping.evaluate.two_tasks import evaluate_task_pairs
    from afford.grasping.policies.load_policy import load_policy
    from afford.grasping.sim.scene import Physics

    if min(params.rounds, params.at_once, params.shown) < 1:
        raise ValueError(f"grasp_two_tasks: expected rounds, at_once and shown of 1 or more, got {params.rounds}, {params.at_once} "
                         f"and {params.shown}")
    physics = Physics(params.rate_hz, params.iterations)
    pairs, seen = evaluate_task_pairs(hand, bodies, load_policy(policy, {}), params.policy, params.engine, physics, params.rounds,
                              params.at_once, params.shown, params.seed, ctx.progress)
    root = empty_folder(ctx.scratch / "sheet")
    rows = {f"{params.policy} {k}": GraspRenderer(hand, task, params.width, params.height, params.supersample).episode(trace)
            for k, (task, trace) in enumerate(seen, 1)}  # fmt: skip
    write_sheet(root / "two_tasks.png", rows)
    return TwoTasksShown(pairs, tree(pairs.name, root))
