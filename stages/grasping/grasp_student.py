"""a teacher, a hand and tasks -> a student that acts like its teacher from depth cameras and proprioception.

Reads   HandModel, GraspTasks to train on, the FileTree of a teacher (rl_grasp_refinement)
Writes  Trained: files (student.json, student.safetensors, tensorboard/, diverged/) and the TrainingLog
Method  DAgger in MuJoCo: the student acts, the teacher, which observes the object's state, labels the visited states; mean squared
        error of actions. Some states are labelled once more, perturbed. The student observes a point cloud, N_t and
        proprioception, estimates from them what the teacher observes, and acts by a copy of the teacher's networks
        (docs/grasping/student.md). A training that was killed resumes to the same weights. The last states of a world that
        diverged are kept, and the world is reset
Fails   without tasks, for files without a teacher, or with head=teacher for a layout other than small
Paper   AffordDex, stage 2, the vision student: R, P from cameras, N; PointNets and a transformer. the
        published values of head, size, views, size_px, points, sampling, layout and n_t are named below
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "gymnasium", "numba", "trimesh", "pillow", "safetensors",
             "protobuf", "blake3", "pybullet")
ENGINE_LIBRARIES = {"warp": ("mujoco-warp", "warp-lang")}
THREADS = 1
MEMORY_GIB = 1.5
MACHINE = "device"
ENGINE_MACHINE = {"warp": True}
GPUS = "device"

ENGINES = {
    "mujoco": "afford.grasping.sim.mujoco_world:MujocoWorld",
    "bullet": "afford.grasping.sim.bullet_world:BulletWorld",
    "warp": "afford.grasping.sim.warp_worlds:WarpWorlds",
}

HEADS = ("teacher", "own")


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_student."""

    name: str = "student"
    """name of the policy and its curves"""
    seed: int = 0
    """seed of weights, object poses and minibatches"""
    rounds: int = 40
    """episodes of every world, each followed by learning"""
    worlds: int = 16
    """worlds simulated at once, at least one per task; tasks are taken in turn"""
    updates: int = 120
    """minibatches after a round"""
    batch: int = 128
    """rows of a minibatch"""
    buffer: int = 80000
    """rows of the replay buffer"""
    led: int = 4
    """rounds over which the share of worlds that the teacher acts in falls from 1 to 0"""
    perturbed: float = 0.5
    """share of the visited states that are labelled once more with displaced fingers and other contact forces"""
    lr: float = 1e-3
    """learning rate of Adam; it falls to 0"""
    head: str = "teacher"
    """teacher: estimate what the teacher observes, and act by a copy of its networks; own: a network of its own, as in the paper"""
    size: str = "small"
    """size of the network: small, or paper"""
    views: int = 2
    """number of cameras; the paper has 5"""
    size_px: int = 96
    """width and height of an image; the paper has 256"""
    points: int = 512
    """points of a cloud; the paper has 1024"""
    sampling: str = "even"
    """sampling of points: even (pixels at even intervals), or farthest (farthest point sampling, the paper's)"""
    layout: str = "small"
    """layout of the robot's own numbers: small, or paper"""
    n_t: str = "first_look"
    """first_look: N_t stays at its place of the first step; tracked: it moves with the object's true pose (the paper's)"""
    randomise: bool = False
    """randomise physics, latency and depth noise over worlds"""
    iterations: int = 100
    """iterations of the physics solver, at most"""
    engine: str = "mujoco"
    """engine of the training: mujoco, bullet or warp (mujoco-warp, all worlds at once; the extra gpu)"""
    device: str = "cpu"
    """device of the networks, and of the worlds with engine=warp: cpu, cuda or cuda:N"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], teacher: FileTree, params: Params, ctx: Context) -> Trained:
    """Train the student in the scratch folder, from which a training that was killed resumes."""
    from afford.common.files import tree
    from afford.grasping.env.device_arrays import arrays_of
    from afford.grasping.env.flight_recorder import FlightRecorder
    from afford.grasping.env.task import from_grasp_task
    from afford.grasping.policies.load_policy import load_policy
    from afford.grasping.policies.train_student import DistillationEnv, DistillationWorlds, export_student, train_student
    from afford.models.loading import device_of
    from afford.training import curves
    from afford.training.loop import deterministic

    policy = load_policy(teacher, {})
    train_tasks = [from_grasp_task(one) for some in tasks for one in some]
    if not train_tasks or policy.teacher is None:
        raise ValueError(f"grasp_student: expected a task or more and the files of a teacher, got {len(train_tasks)} tasks and "
                         f"{teacher.name} with {', '.join(file.name for file in teacher.files) or 'no file'}")
    if params.engine not in ENGINES:
        raise ValueError(f"grasp_student: expected an engine of {', '.join(ENGINES)}, got {params.engine!r}")
    if params.head not in HEADS:
        raise ValueError(f"grasp_student: expected a head of {', '.join(HEADS)}, got {params.head!r}")
    sensors, recorder = _sensors(params), FlightRecorder(ctx.scratch, params.engine, params.seed)
    with deterministic(THREADS, params.device.partition(":")[0]):
        for network in filter(None, (policy.teacher, policy.prior)):
            network.to(device_of(params.device))
        chosen = [train_tasks[k % len(train_tasks)] for k in range(max(params.worlds, len(train_tasks)))]
        core = DistillationWorlds(hand, chosen, _env_config(params, policy), recorder, arrays_of(params.engine, params.device))
        try:
            envs = DistillationEnv(core, policy.actor(core), sensors, recorder, params.head == "teacher")
            model, state = train_student(envs, params.size, _training_config(params), ctx.scratch, ctx.progress, params.device)
        finally:
            core.close()
    root = export_student(ctx.scratch, model, sensors, {**policy.facts, "seed": params.seed})
    return Trained(tree(params.name, root), curves.training_log(params.name, state.points, state.best_step, state.step))


def _env_config(p: Params, policy):  # type: ignore[no-untyped-def]  # types of leaf modules, which are imported inside functions
    from dataclasses import replace

    from afford.grasping.sim.scene import Physics

    return replace(policy.config(p.engine, Physics(iterations=p.iterations), "flat", 0.0), randomise=p.randomise, seed=p.seed,
                   device=p.device if p.engine == "warp" else "cpu")  # fmt: skip


def _sensors(p: Params):  # type: ignore[no-untyped-def]  # as above
    from afford.grasping.policies.depth_cameras import CameraRig
    from afford.grasping.policies.student import StudentSensors
    from afford.grasping.policies.student_obs import CloudSampling

    return StudentSensors(CameraRig(p.views, p.size_px), CloudSampling(p.points, p.sampling, p.layout), p.n_t)


def _training_config(p: Params):  # type: ignore[no-untyped-def]  # as above
    from afford.grasping.rl.dagger import DaggerConfig

    return DaggerConfig(p.rounds, p.updates, p.batch, p.buffer, p.led, p.perturbed, p.lr, seed=p.seed)
