"""a teacher, the tasks of one body -> the teacher adapted to these tasks in minutes, or as it was.

Reads   HandModel; GraspTasks of one body (body_tasks); the files of a teacher (rl_grasp_refinement)
Writes  Trained: the files of the teacher, with the folder adapted (policy.json, policy.safetensors) where a network is better in
        some tasks; and the TrainingLog, whose best_step is 0 for the teacher as it was
Method  scripted grasps that lift the body, found by an evolution strategy in MuJoCo and PyBullet, are cloned by DAgger; the best
        weights on episodes of the training are kept, for the tasks in which they are better than the teacher; the others are left
        to it. A training that was killed resumes to the same weights from its last checkpoint
Fails   ValueError for a policy that is no teacher, or when a loss is not finite
Paper   none: AffordDex evaluates without adaptation; DAgger is Ross et al. 2011
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "gymnasium", "trimesh", "numba", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_adapt."""

    seed: int = 0
    """seed of the search, of noise and of object poses"""
    worlds: int = 16
    """worlds in MuJoCo, of all tasks at hand together, two of each at least; the size of a generation"""
    bullet: int = 4
    """worlds in PyBullet, where the best grasps of a generation are tried again; 0 for none"""
    generations: int = 10
    """generations of the search of a task, at most"""
    trials: int = 160
    """episodes of the search of a body, of all its tasks in both engines together, at most"""
    sure: int = 2
    """trials in each engine, in all of which a scripted grasp holds, that end the search"""
    rounds: int = 5
    """rounds of DAgger, an episode of every world each"""
    updates: int = 500
    """minibatches of a round"""
    batch: int = 256
    """rows of a minibatch"""
    lr: float = 1e-3
    """learning rate of Adam; it falls to a tenth"""
    noise: float = 0.1
    """standard deviation of the noise that is added to actions"""
    enough: float = 0.9
    """score (0..1) of the teacher in a task from which no other grasp is searched"""
    iterations: int = 100
    """iterations of the physics solver, at most, as in body_evaluate: with fewer, other grasps hold in PyBullet"""
    rate_hz: int = 480
    """rate of the physics solver, as in body_evaluate: at half of it, other grasps hold in MuJoCo"""
    carry: bool = True
    """as body_evaluate.carry, for the teacher, the scripts and the adapted policy"""


def run(hand: HandModel, tasks: tuple[GraspTask, ...], policy: FileTree, params: Params, ctx: Context) -> Trained:
    """Adapt the teacher in the scratch folder, from which an adaptation that was killed resumes."""
    from afford.common.files import tree
    from afford.grasping.policies.adapt_teacher import AdaptationConfig, adapt_teacher
    from afford.grasping.policies.adapted_policy import write_adapted
    from afford.grasping.policies.load_policy import load_policy
    from afford.training import curves
    from afford.training.loop import deterministic

    for name, least in (("worlds", 2), ("bullet", 0), ("generations", 1), ("trials", 1), ("sure", 1), ("rounds", 1), ("updates", 1),
                        ("batch", 1)):  # fmt: skip
        if getattr(params, name) < least:
            raise ValueError(f"body_adapt.{name}: expected {least} or more, got {getattr(params, name)}")
    name = tasks[0].body.name if tasks else "adapted"
    if not tasks:
        return Trained(policy, curves.training_log(name, (), 0, 0))
    with deterministic(THREADS, "cpu"):
        teacher = load_policy(policy, {})
        made = adapt_teacher(hand, tasks, teacher, AdaptationConfig(**asdict(params)), ctx.scratch, ctx.progress)
    files = tree(name, write_adapted(ctx.scratch / "out", policy, made.model, teacher, made.tasks)) if made.tasks else policy
    return Trained(files, curves.training_log(name, made.state.points, made.state.best_step, made.state.step))
