"""a teacher, a hand and tasks -> a student that sees what a robot sees, and acts like its teacher.

Reads   HandModel, GraspTasks to learn on, the FileTree of a teacher (rl_grasp_refinement)
Writes  Trained: files (student.json, student.safetensors, tensorboard/) and the TrainingLog
Method  DAgger in MuJoCo: the student acts, the teacher, which sees the object's state, says what it would have done; the mean
        squared error of that. The student sees depth as a cloud, N_t, and the robot's own senses (docs/grasping/student.md).
        Killed, it goes on to the same weights
Fails   without tasks, for files that are no teacher
Paper   AffordDex, stage 2, the vision student: R, P from cameras, N; PointNets and a transformer. size,
        views, size_px, points, sampling, layout and n_t have values that are the paper's
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
THREADS = 1
MEMORY_GIB = 3.0


@dataclass(frozen=True)
class Params:
    name: str = "student"
    """of the policy and its curves"""
    seed: int = 0
    """of weights, places, yaws and minibatches"""
    rounds: int = 40
    """episodes of every world, each followed by learning"""
    worlds: int = 16
    """computed side by side, at least one for each task; tasks are taken in turn"""
    updates: int = 120
    """minibatches after a round"""
    batch: int = 128
    """moments in a minibatch"""
    buffer: int = 80000
    """moments that are remembered"""
    led: int = 4
    """rounds over which the teacher's share of the worlds falls to none"""
    lr: float = 1e-3
    """of Adam; it falls to 0"""
    size: str = "small"
    """of the network: small, or paper"""
    views: int = 2
    """cameras; the paper has 5"""
    size_px: int = 96
    """of a picture; the paper has 256"""
    points: int = 512
    """of a cloud; the paper has 1024"""
    sampling: str = "even"
    """of points among pixels: even, or farthest (the paper's)"""
    layout: str = "small"
    """of the robot's own numbers: small, or paper"""
    n_t: str = "first_look"
    """first_look: N_t stays where it lay at first; tracked: it moves with the object's true pose (the paper's)"""
    randomise: bool = False
    """whether physics, latency and the noise of depth differ between worlds"""
    iterations: int = 100
    """of the physics' solver, at most"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], teacher: FileTree, params: Params, ctx: Context) -> Trained:
    """Train in the scratch folder, where a killed training goes on."""
    from afford.common.files import tree
    from afford.grasping.env.core import Grasping
    from afford.grasping.env.task import of
    from afford.grasping.policies import acting, teach
    from afford.grasping.policies.lessons import Lessons
    from afford.training import curves
    from afford.training.loop import deterministic

    expert = acting.load(teacher, {})
    mine = [of(one) for some in tasks for one in some]
    if not mine or expert.teacher is None:
        raise ValueError(f"grasp_student: expected a task or more and the files of a teacher, got {len(mine)} tasks and "
                         f"{teacher.name} with {', '.join(file.name for file in teacher.files) or 'no file'}")
    with deterministic(THREADS, "cpu"):
        chosen = [mine[k % len(mine)] for k in range(max(params.worlds, len(mine)))]
        core = Grasping(hand, chosen, _config(params, expert))
        try:
            lessons = Lessons(core, expert.actor(core), _senses(params), params.seed)
            model, state = teach.train(lessons, params.size, _plan(params), ctx.scratch, ctx.progress)
        finally:
            core.close()
    root = teach.write(ctx.scratch, model, _senses(params), {**expert.facts, "seed": params.seed})
    return Trained(tree(params.name, root), curves.training_log(params.name, state.points, state.best_step, state.step))


def _config(p: Params, expert):  # type: ignore[no-untyped-def]  # Policy and Config are leafs' types, and leafs load inside `run`
    from dataclasses import replace

    from afford.grasping.sim.scene import Physics

    return replace(expert.config("mujoco", Physics(iterations=p.iterations), "flat", 0.0), randomise=p.randomise, seed=p.seed)


def _senses(p: Params):  # type: ignore[no-untyped-def]  # Senses is a leaf's type, and leafs load inside `run`
    from afford.grasping.policies.cameras import Rig
    from afford.grasping.policies.sight import Eyes
    from afford.grasping.policies.student import Senses

    return Senses(Rig(p.views, p.size_px), Eyes(p.points, p.sampling, p.layout), p.n_t)


def _plan(p: Params):  # type: ignore[no-untyped-def]  # Config is a leaf's type, and leafs load inside `run`
    from afford.grasping.rl.dagger import Config

    return Config(p.rounds, p.updates, p.batch, p.buffer, p.led, p.lr, seed=p.seed)
