"""a hand, a trained teacher and tasks of bodies -> the teacher trained further on them, beginning over places of grasp families.

Reads   HandModel, GraspTasks of bodies (household_tasks), the FileTree of a teacher (rl_grasp_refinement)
Writes  Trained: files (policy.json, policy.safetensors, prior/, tensorboard/, diverged/) and the TrainingLog
Method  PPO from the weights of the teacher, as a residual over its frozen prior, with its rewards, in MuJoCo; worlds and carry are
        those of body_evaluate, but every second hand begins a little off its place. A training that was killed resumes to the
        same weights
Fails   without a task, for a policy that is not a teacher, when a loss is not finite
Paper   AffordDex trains one policy on all objects of UniDexGrasp; places by grasp families are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "trimesh", "mujoco", "pybullet", "gymnasium", "numba", "safetensors", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 2.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_refinement."""

    name: str = "bodies"
    """name of the policy and its curves"""
    seed: int = 0
    """seed of noise and object poses"""
    updates: int = 140
    """updates of PPO, each after one episode of every world"""
    family_worlds: int = 24
    """worlds of each grasp family, at least; the tasks of a rare one have several"""
    off_m: float = 0.007
    """every second hand begins off its place, by a normal distribution of this standard deviation along x and y"""
    off_rad: float = 0.1
    """the same for its yaw"""
    lambda_n: float = 1.0
    """scale of the negative reward terms; 0 for none"""
    lr: float = 3e-4
    """learning rate of Adam; it falls to 0"""
    epochs: int = 6
    """passes over a rollout"""
    gamma: float = 0.97
    """discount"""
    std: float = 0.1
    """standard deviation of actions at the start"""
    std_along: float = 0.2
    """the same for the first action, which moves the hand along the object"""
    iterations: int = 100
    """iterations of the physics solver, at most"""
    rate_hz: int = 240
    """rate of the physics solver"""
    carry: bool = True
    """as body_evaluate.carry"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], policy: FileTree, params: Params, ctx: Context) -> Trained:
    """Train the teacher further in the scratch folder, from which a training that was killed resumes."""
    from afford.common.files import tree
    from afford.grasping.policies.load_policy import load_policy
    from afford.grasping.policies.refine_on_bodies import RefinementConfig, refine_on_bodies
    from afford.grasping.policies.train_teacher import TeacherTrainingConfig
    from afford.grasping.rl.ppo import PPOConfig
    from afford.training import curves
    from afford.training.loop import deterministic

    p, given = params, [one for some in tasks for one in some]
    if not given or p.lambda_n < 0 or min(p.off_m, p.off_rad, p.family_worlds) < 0 or p.updates < 1:
        raise ValueError(f"body_refinement: expected a task or more, updates of 1 or more, and off_m, off_rad, family_worlds and "
                         f"lambda_n of 0 or more, got {len(given)} tasks, {p.updates}, {p.off_m:g}, {p.off_rad:g}, "
                         f"{p.family_worlds} and {p.lambda_n:g}")
    with deterministic(THREADS, "cpu"):
        teacher = load_policy(policy, {})
        ppo = PPOConfig(updates=p.updates, steps=int(teacher.facts["steps"]), epochs=p.epochs, lr=p.lr, gamma=p.gamma)
        plan = TeacherTrainingConfig(p.seed, len(given), "small", p.std, p.std_along, ppo)
        root, state = refine_on_bodies(hand, given, teacher, RefinementConfig(plan, p.off_m, p.off_rad, p.family_worlds, p.lambda_n,
                                       p.iterations, p.rate_hz, p.carry), ctx.scratch, ctx.progress)  # fmt: skip
    return Trained(tree(p.name, root), curves.training_log(p.name, state.points, state.best_step, state.step))
