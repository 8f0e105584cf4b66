"""a hand, objects and human grasps of them -> the prior, a policy that imitates human motion (AffordDex, stage 1: HTI).

Reads   HandModel; GraspObjects; GraspTargets and the ReferenceSet of their clips, each clip named <target>_<number> and in the
        frame of its target's world; clips of a source other than `synthetic` are recorded ones, which have a place of their own
Writes  Trained: policy.json (network, facts: role, layout, rates, steps, start), policy.safetensors, tensorboard/, diverged/;
        curves
Method  clips that do not lift their object in simulation are dropped; then DAgger (the expert follows the clip; along the object
        it makes the clip's moves from wherever the hand is), then PPO with imitation rewards. The object is present and observed
        as AffordanceGrasp shows it to a prior, without parts. A training that was killed resumes to the same weights.
        The last states of a world that diverged are kept, and the world is reset
Fails   ValueError: no clip lifts its object, a clip without a target or an object, a parameter out of range
Paper   AffordDex, HTI: PPO alone, imitation and smoothness; clips of OakInk2; the prior is frozen afterwards
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel, ReferenceSet
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "scipy", "torch", "safetensors", "trimesh", "mujoco", "pybullet", "gymnasium", "protobuf", "blake3")
ENGINE_LIBRARIES = {"warp": ("mujoco-warp", "warp-lang")}
THREADS = 2
MEMORY_GIB = 2.0
TIMEOUT_S = 14400.0  # simulates its data before the first report of progress
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
    """Parameters of hand_imitation."""

    seed: int = 0
    """seed of weights, episodes and noise"""
    cloning: int = 60
    """updates of DAgger, each with one episode of every world"""
    alone: int = 20
    """update from which the policy acts in all worlds; before, the expert acts in a falling share of them"""
    memory: int = 12
    """episodes of every world in the replay buffer"""
    passes: int = 2
    """passes over the buffer in an update"""
    batch: int = 512
    """rows of a minibatch"""
    lr: float = 1e-3
    """learning rate of DAgger; it falls to a tenth"""
    noise: float = 0.08
    """standard deviation of the noise on actions in DAgger"""
    nudged: float = 0.5
    """share of episodes in which the hand is moved along the object on its way down"""
    reinforcing: int = 0
    """updates of PPO; they made the prior worse (docs/grasping/imitation.md)"""
    critic: int = 6
    """first updates of PPO, at most, in which only the critic learns"""
    settled: float = 0.5
    """explained variance of returns from which the critic has settled and the policy learns"""
    anchor: float = 1.0
    """weight of the squared difference from the expert's actions in PPO; without it grasps are lost"""
    ppo_lr: float = 1e-4
    """learning rate of PPO; it falls to 0"""
    ppo_kl: float = 0.02
    """beyond 1.5 times this divergence an update of PPO changes the critic only"""
    ppo_std: float = 0.05
    """standard deviation of actions in PPO"""
    reward: str = "paper"
    """paper: fingers and power; code: what AffordDex's code has (docs/grasping/grasp-environments.md)"""
    worlds: int = 24
    """worlds simulated at once; objects are taken in turn"""
    steps: int = 40
    """control steps of an episode"""
    lift_m: float = 0.20
    """height to which clips lift"""
    hidden: tuple[int, ...] = (256, 256)
    """widths of the hidden layers"""
    std: float = 0.12
    """standard deviation of actions of the cloned policy; PPO has its own"""
    proofs: int = 1
    """a clip is kept when this many simulated episodes of it end with the object held, in each engine; 0 keeps all clips"""
    proof_engines: tuple[str, ...] = ("mujoco", "bullet")
    """engines of this test"""
    shift_m: float = 0.03
    """largest shift of clips along their object, both ways"""
    astray: tuple[float, float, float] = (0.006, 0.04, 0.06)
    """standard deviations of the start: m and rad of the wrist, rad of the fingers"""
    engine: str = "mujoco"
    """engine of the training: mujoco, bullet or warp (mujoco-warp, all worlds at once; the extra gpu)"""
    device: str = "cpu"
    """device of the networks, and of the worlds with engine=warp: cpu, cuda or cuda:N"""


def run(hand: HandModel, bodies: tuple[GraspObject, ...], targets: tuple[GraspTarget, ...], references: ReferenceSet,
        params: Params, ctx: Context) -> Trained:  # fmt: skip
    """Train the prior in the scratch folder, from which a training that was killed resumes."""
    from afford.common.files import tree
    from afford.grasping.env.device_arrays import arrays_of
    from afford.grasping.env.flight_recorder import FlightRecorder, export_records
    from afford.grasping.imitation.clip_filter import prior_data
    from afford.grasping.imitation.train_prior import export_prior, new_prior, train_prior
    from afford.models.loading import device_of
    from afford.training import curves
    from afford.training.loop import deterministic

    _check(params)
    recorder = FlightRecorder(ctx.scratch, params.engine, params.seed)
    shown = {one.name for one in references.references}
    recorded = tuple(one.name for one in references.report.verdicts if one.name in shown and one.source != "synthetic")
    with deterministic(1, params.device.partition(":")[0]):  # the second thread computes worlds, so torch gets one
        data = prior_data(hand, bodies, targets, references.references, replace(_env_config(params), fixed=recorded), params.proofs,
                          params.proof_engines, params.worlds, params.seed, recorder, arrays_of(params.engine, params.device))
        model = new_prior(data.core, params.hidden, params.std, params.seed).to(device_of(params.device))
        points = [*data.points, *train_prior(data.core, model, _training_config(params), ctx.scratch, ctx.progress, recorder)]
        data.core.close()
    root = export_prior(ctx.scratch / "out", model, data.facts)
    export_records(ctx.scratch, root)
    curves.write_events(root / "tensorboard", points)
    done = params.cloning + params.reinforcing
    return Trained(tree("prior", root), curves.training_log("prior", points, done, done))


def _env_config(p: Params):  # type: ignore[no-untyped-def]  # its type is in a leaf module, which is imported inside functions
    from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig

    return GraspImitationConfig(engine=p.engine, reward=p.reward, steps=p.steps, lift_m=p.lift_m, shift_m=p.shift_m,
                                astray=p.astray, threads=1 if p.engine == "warp" else THREADS,
                                device=p.device if p.engine == "warp" else "cpu")  # fmt: skip


def _training_config(p: Params):  # type: ignore[no-untyped-def]  # as above
    from afford.grasping.imitation.train_prior import PriorTrainingConfig
    from afford.grasping.rl.ppo import PPOConfig

    ppo = PPOConfig(updates=p.reinforcing, steps=p.steps, lr=p.ppo_lr, target_kl=p.ppo_kl)
    return PriorTrainingConfig(seed=p.seed, cloning=p.cloning, alone=p.alone, memory=p.memory, passes=p.passes, batch=p.batch,
                               lr=p.lr, nudged=p.nudged, noise=p.noise, critic=p.critic, settled=p.settled, anchor=p.anchor,
                               std=p.ppo_std, ppo=ppo)  # fmt: skip


def _check(p: Params) -> None:
    if p.engine not in ENGINES:
        raise ValueError(f"hand_imitation: expected an engine of {', '.join(ENGINES)}, got {p.engine!r}")
    for name, least in (("cloning", 1), ("memory", 1), ("passes", 1), ("batch", 1), ("worlds", 1), ("steps", 1), ("reinforcing", 0),
                        ("alone", 0), ("critic", 0), ("proofs", 0), ("noise", 0), ("shift_m", 0), ("anchor", 0),
                        ("ppo_kl", 0)):  # fmt: skip
        if not getattr(p, name) >= least:
            raise ValueError(f"hand_imitation, {name}: expected {least} or more, got {getattr(p, name)}")
    if not p.ppo_std > 0:
        raise ValueError(f"hand_imitation, ppo_std: expected a number above 0, got {p.ppo_std}")
    if not 0 <= p.nudged <= 1:
        raise ValueError(f"hand_imitation, nudged: expected a share of 0 to 1, got {p.nudged}")
