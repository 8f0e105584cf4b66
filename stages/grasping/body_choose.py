"""a policy, the tasks of one mesh -> the same tasks, each at the place where the policy did best in trials.

Reads   HandModel; BodyTasks and PartDescriptions of the mesh; the policy (FileTree of rl_grasp_refinement or body_refinement)
Writes  BodyTasks: the pose and the held part of a task may be others, its use, N_t and negative parts are not; a note on each task
        that is grasped elsewhere than its shape suggests
Method  options of a task are its place by shape, then other places of the parts that may be held and of their convex pieces, in
        all stable poses, by fit; the policy plays them from starts that no evaluation has, and the place where it does best in all
        engines is taken
Fails   ValueError for numbers out of range, or a policy that does not fit the environment
Paper   AffordDex and UniDexGrasp choose grasps by networks; trials in simulation before an execution are ours
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from schemas.bodies import BodyTasks
from schemas.files import FileTree
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.surface import PartDescriptions

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "gymnasium", "trimesh", "numba", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_choose."""

    options: int = 16
    """places that are tried for each task, at most; 1 keeps the place that the shape suggests"""
    turned: bool = True
    """try all stable poses; false: the body stays as it was laid"""
    finalists: int = 4
    """places other than that which are tried in all engines, at most"""
    episodes: int = 3
    """episodes at each place in each engine"""
    enough: float = 0.95
    """score (0..1: mean of success and held, times the share of fingertips off N_t) from which no other place is tried"""
    engines: tuple[str, ...] = ("mujoco", "bullet")
    """engines of the trials, which weigh alike; all options are played in the first"""
    iterations: int = 100
    """iterations of the physics solver, as in body_evaluate"""
    rate_hz: int = 480
    """rate of the physics solver, as in body_evaluate"""
    seed: int = 20269
    """seed of object poses; not that of body_evaluate"""
    carry: bool = True
    """as body_evaluate.carry"""


def run(hand: HandModel, body: BodyTasks, descriptions: PartDescriptions, policy: FileTree, params: Params,
        ctx: Context) -> BodyTasks:  # fmt: skip
    """Choose the place of each task of one mesh."""
    from afford.grasping.policies.load_policy import load_policy
    from afford.grasping.policies.place_trials import TrialSettings, choose_places
    from afford.grasping.sim.engine import check_stage_engine

    if params.options < 1 or params.episodes < 1 or not params.engines:
        raise ValueError(f"body_choose: expected options and episodes of 1 or more and an engine, got {params.options}, "
                         f"{params.episodes} and {len(params.engines)} engines")
    for engine in params.engines:
        check_stage_engine(engine)
    if params.options == 1:
        return body
    return choose_places(hand, body, descriptions, load_policy(policy, {}), TrialSettings(**asdict(params)), ctx.progress)
