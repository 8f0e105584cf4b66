"""a hand, tasks and a frozen prior -> a teacher that grasps and keeps off negative parts.

Reads   HandModel, GraspTasks to train on, the FileTree of a prior (hand_imitation) in a tuple, or an empty tuple
Writes  Trained: files (policy.json, policy.safetensors, prior/, tensorboard/, diverged/) and the TrainingLog
Method  residual reinforcement learning: a = clip(a_H + a_T, -1, 1), element-wise; the prior observes R O P, the teacher R O P N;
        PPO in MuJoCo, worlds take the tasks in turn, a fixed number of updates; the prior stays frozen. A training that was killed
        resumes to the same weights. The last states of a world that diverged are kept, and the world is reset
Fails   without tasks, without a prior where base=prior, when a loss is not finite
Paper   AffordDex, stage 2, the teacher with its negative affordance-aware rewards; the published ones are
        reward=afforddex and size=paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "trimesh", "mujoco", "pybullet", "gymnasium", "safetensors", "protobuf", "blake3")
ENGINE_LIBRARIES = {"warp": ("mujoco-warp", "warp-lang")}
THREADS = 1
MEMORY_GIB = 2.0
MACHINE = "device"
ENGINE_MACHINE = {"warp": True}
GPUS = "device"

ENGINES = {
    "mujoco": "afford.grasping.sim.mujoco_world:MujocoWorld",
    "bullet": "afford.grasping.sim.bullet_world:BulletWorld",
    "warp": "afford.grasping.sim.warp_worlds:WarpWorlds",
}


@dataclass(frozen=True)
class Params:
    """Parameters of rl_grasp_refinement."""

    name: str = "teacher"
    """name of the policy and its curves"""
    seed: int = 0
    """seed of weights, noise and object poses"""
    updates: int = 200
    """updates of PPO, each after one episode of every world"""
    worlds: int = 32
    """worlds simulated at once, at least one per task; tasks are taken in turn"""
    base: str = "prior"
    """base of the residual: none, script (a scripted grasp at the place of the hand), or prior (hand_imitation). For script, whose
    actions are finer, std=0.1, std_along=0.35 and steps=44 work well"""
    lambda_n: float = 1.0
    """scale of the negative reward terms; 0 for none"""
    positive: float = 0.0
    """weight of the term `positive`, the distance in metres from fingertips to A_t; a negative weight attracts them"""
    reward: str = "dense"
    """set of reward terms (afford/grasping/env/reward.py)"""
    size: str = "small"
    """size of the networks: small, or paper (1024-1024-512-512)"""
    layout: str = "small"
    """layout of observations: small, paper or points (afford/grasping/env/obs_blocks.py)"""
    start_m: float = 0.06
    """largest distance along the object from the centre of mass to the place over which the hand begins, independent of parts"""
    steps: int = 40
    """control steps of an episode; a prior observes time as a share of it"""
    wait: int = 6
    """base=script: control steps before the hand descends, for moves along the object"""
    iterations: int = 100
    """iterations of the physics solver, at most"""
    lr: float = 3e-4
    """learning rate of Adam; it falls to 0"""
    epochs: int = 6
    """passes over a rollout"""
    gamma: float = 0.97
    """discount"""
    std: float = 0.06
    """standard deviation of actions at the start; more makes the hand drop what the base holds"""
    std_along: float = 0.2
    """the same for the first action, which moves the hand along the object"""
    engine: str = "mujoco"
    """engine of the training: mujoco, bullet or warp (mujoco-warp, all worlds at once; the extra gpu)"""
    device: str = "cpu"
    """device of the networks, and of the worlds with engine=warp: cpu, cuda or cuda:N"""


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
    if params.engine not in ENGINES:
        raise ValueError(f"rl_grasp_refinement: expected an engine of {', '.join(ENGINES)}, got {params.engine!r}")
    network, facts = read_policy(prior[0]) if prior else (None, {})
    config = _env_config(params, tuple(facts.get("posture", ())))
    with deterministic(THREADS, params.device.partition(":")[0]):
        frozen = FrozenPrior(network, params.layout) if network else None
        plan = _training_config(params, len(train_tasks))
        model, state = train_teacher(hand, train_tasks, frozen, config, plan, ctx.scratch, ctx.progress, params.device)
    root = export_teacher(ctx.scratch, model, frozen, config, params.seed)
    return Trained(tree(params.name, root), curves.training_log(params.name, state.points, state.best_step, state.step))


def _env_config(p: Params, posture: tuple[float, ...]):  # type: ignore[no-untyped-def]  # types of leaf modules, imported inside
    from afford.grasping.env.config import GraspEnvConfig
    from afford.grasping.env.reward import scaled_negative_weights
    from afford.grasping.sim.scene import Physics

    weights = {**scaled_negative_weights(p.reward, p.lambda_n), **({"positive": p.positive} if p.positive else {})}
    return GraspEnvConfig(engine=p.engine, physics=Physics(iterations=p.iterations), base=p.base, posture=posture, layout=p.layout,
                          reward=p.reward, start="anywhere", weights=weights, steps=p.steps, start_m=p.start_m,
                          wait=p.wait if p.base == "script" else 0, seed=p.seed,
                          device=p.device if p.engine == "warp" else "cpu")  # fmt: skip


def _training_config(p: Params, tasks: int):  # type: ignore[no-untyped-def]  # as above
    from afford.grasping.policies.train_teacher import TeacherTrainingConfig
    from afford.grasping.rl.ppo import PPOConfig

    return TeacherTrainingConfig(p.seed, max(p.worlds, tasks), p.size, p.std, p.std_along,
                                 PPOConfig(updates=p.updates, steps=p.steps, epochs=p.epochs, lr=p.lr, gamma=p.gamma))  # fmt: skip
