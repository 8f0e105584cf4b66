"""a hand, tasks and a frozen prior -> a teacher that grasps, and keeps off what must not be touched.

Reads   HandModel, GraspTasks to learn on, the FileTree of a prior (hand_imitation) in a tuple, or none
Writes  Trained: files (policy.json, policy.safetensors, prior/, tensorboard/) and the TrainingLog
Method  residual reinforcement learning: a = clip(a_H + a_T, -1, 1), element-wise; the prior sees R O P, the teacher R O P N; PPO in
        MuJoCo, one world for each task in turn, bounded by updates; the prior's weights are not touched. Killed, it goes on to the
        same weights
Fails   without tasks, without a prior where base asks for one, when a loss is not finite any more
Paper   AffordDex, stage 2, the teacher with its negative affordance-aware rewards; rewards and sizes are
        Params, the paper's are reward=afforddex and size=paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "trimesh", "mujoco", "pybullet", "gymnasium", "safetensors", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 2.0


@dataclass(frozen=True)
class Params:
    name: str = "teacher"
    """of the policy and its curves"""
    seed: int = 0
    """of weights, noise, places and yaws"""
    updates: int = 200
    """of PPO; each follows one episode of every world"""
    worlds: int = 32
    """computed side by side, at least one for each task; tasks are taken in turn"""
    base: str = "prior"
    """what the teacher adds to: none, script (a grasp where the hand happens to be), or prior (hand_imitation). For script, whose
    actions are finer, std=0.1, std_along=0.35 and steps=44 were found to be good"""
    lambda_n: float = 1.0
    """times the negative terms of the reward; 0 for none"""
    positive: float = 0.0
    """weight of the term `positive`: per metre from fingertips to where hands belong (A_t), so below 0 where it is to draw them"""
    reward: str = "dense"
    """set of rewards (afford/grasping/env/reward.py)"""
    size: str = "small"
    """of the networks: small, or paper (1024-1024-512-512)"""
    layout: str = "small"
    """of observations: small, paper or points (afford/grasping/env/obs_blocks.py)"""
    start_m: float = 0.06
    """the hand begins over a place along the object that is at most so far from the centre of mass, blind to parts"""
    steps: int = 40
    """control steps of an episode; what a prior sees of time is a share of it"""
    wait: int = 6
    """base=script: control steps before it goes down, so that there is time to move along the object"""
    iterations: int = 100
    """of the physics' solver, at most"""
    lr: float = 3e-4
    """of Adam; it falls to 0"""
    epochs: int = 6
    """passes over what an update has seen"""
    gamma: float = 0.97
    """discount"""
    std: float = 0.06
    """spread of actions in the beginning: more of it drops what the base holds"""
    std_along: float = 0.2
    """of the first one, which moves the hand along the object"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], prior: tuple[FileTree, ...], params: Params,
        ctx: Context) -> Trained:  # fmt: skip
    """Train the teacher in the scratch folder, from which a training that was killed resumes."""
    from afford.common.files import tree
    from afford.grasping.env.task import from_grasp_task
    from afford.grasping.policies.train_teacher import FrozenPrior, export_teacher, train_teacher
    from afford.grasping.rl.policy_files import read_policy
    from afford.training import curves
    from afford.training.loop import deterministic

    train_tasks = [from_grasp_task(one) for some in tasks for one in some]
    if not train_tasks or params.lambda_n < 0 or (params.base == "prior") != bool(prior):
        raise ValueError(f"rl_grasp_refinement: expected a task or more, lambda_n of 0 or more, and a prior where base=prior and "
                         f"none elsewhere, got {len(train_tasks)} tasks, {params.lambda_n:g}, base={params.base} and "
                         f"{len(prior)} priors")
    network, facts = read_policy(prior[0]) if prior else (None, {})
    config = _env_config(params, tuple(facts.get("posture", ())))
    with deterministic(THREADS, "cpu"):
        frozen = FrozenPrior(network, params.layout) if network else None
        plan = _training_config(params, len(train_tasks))
        model, state = train_teacher(hand, train_tasks, frozen, config, plan, ctx.scratch, ctx.progress)
    root = export_teacher(ctx.scratch, model, frozen, config, params.seed)
    return Trained(tree(params.name, root), curves.training_log(params.name, state.points, state.best_step, state.step))


def _env_config(p: Params, posture: tuple[float, ...]):  # type: ignore[no-untyped-def]  # types of leaf modules, imported inside
    from afford.grasping.env.config import GraspEnvConfig
    from afford.grasping.env.reward import scaled_negative_weights
    from afford.grasping.sim.scene import Physics

    weights = {**scaled_negative_weights(p.reward, p.lambda_n), **({"positive": p.positive} if p.positive else {})}
    return GraspEnvConfig(physics=Physics(iterations=p.iterations), base=p.base, posture=posture, layout=p.layout, reward=p.reward,
                          start="anywhere", weights=weights, steps=p.steps, start_m=p.start_m,
                          wait=p.wait if p.base == "script" else 0, seed=p.seed)  # fmt: skip


def _training_config(p: Params, tasks: int):  # type: ignore[no-untyped-def]  # as above
    from afford.grasping.policies.train_teacher import TeacherTrainingConfig
    from afford.grasping.rl.ppo import PPOConfig

    return TeacherTrainingConfig(p.seed, max(p.worlds, tasks), p.size, p.std, p.std_along,
                                 PPOConfig(updates=p.updates, steps=p.steps, epochs=p.epochs, lr=p.lr, gamma=p.gamma))  # fmt: skip
