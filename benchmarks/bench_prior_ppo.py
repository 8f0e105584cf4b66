"""Continue the shipped prior by PPO with the paper's imitation reward: anchored to the expert, and not anchored.

    PYTHONPATH=. python benchmarks/bench_prior_ppo.py [UPDATES]

Prints a table: figures of held-out clips (other places and motions of the same 7 tools) before and after.
MuJoCo, 63 episodes each, one seed.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from afford.common.files import tree
from afford.grasping.env.task import make_task
from afford.grasping.hand.assets import shadow_files
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from afford.grasping.imitation.train_prior import PriorTrainingConfig, train_prior
from afford.grasping.rl import policy_files
from afford.grasping.rl.ppo import ActorCritic, PPOConfig, mlp
from benchmarks.pages import ROOT
from maps.grasping import HELD
from maps.settings.grasping import FITTED, MOTION
from schemas.grasp import GraspObject
from schemas.hand import HandModel, HandReference
from schemas.mesh import ObjectSpec
from stages.grasping import grasp_targets, hand_imitation, hand_model, hand_retarget, motion_synthesise, object_solids
from stages.synthetic import object_build

SHIPPED, ROUNDS, WORLDS = ROOT / "weights" / "grasp-prior", 3, 24
HELD_OUT = 7919
"""offset of the seeds of held-out clips"""
FIGURES = ("held", "level_1_m", "level_2_m", "tips_error_m", "return")


def main() -> None:
    """Print the table, row by row."""
    torch.set_num_threads(1)
    hand = hand_model.run(shadow_files(), hand_model.Params())
    made = [object_build.run(ObjectSpec(one, one, 11, "plain", "train"), object_build.Params(atlas_px=64)) for one in HELD]
    bodies = [object_solids.run(one.mesh, one.parts, object_solids.Params()) for one in made]
    exact = GraspImitationConfig(steps=40)
    shaken = replace(exact, shift_m=0.03, astray=hand_imitation.Params().astray)
    test = worlds(hand, bodies, clips(hand, bodies, 2, HELD_OUT), exact, 3 * len(bodies))
    training = worlds(hand, bodies, clips(hand, bodies, 4, 0), shaken, WORLDS)
    updates = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    sys.stdout.write(f"| prior | {' | '.join(FIGURES)} | explained variance |\n|---|{'--:|' * (len(FIGURES) + 1)}\n")
    for name, anchor, count in (("cloned", 1.0, 0), ("PPO, anchored", 1.0, updates), ("PPO, not anchored", 0.0, updates)):
        model, explained = prior(), float("nan")
        if count:
            with tempfile.TemporaryDirectory() as folder:
                points = train_prior(training, model, config(anchor, count), Path(folder), lambda done, total: None)
            explained = [point.value for point in points if point.name == "ppo.explained_variance"][-1]
        cells = " | ".join(f"{value:.4g}" for value in (*evaluate(test, model), explained))
        sys.stdout.write(f"| {name} | {cells} |\n")
        sys.stdout.flush()


def clips(hand: HandModel, bodies: list[GraspObject], places: int, seed: int) -> list[HandReference]:
    """Synthesize clips of all tools."""
    motion = replace(MOTION, seed=MOTION.seed + seed)
    targets = [one for body in bodies for one in grasp_targets.run(body, hand, grasp_targets.Params(places=places, seed=seed))]
    found = [hand_retarget.run(motion_synthesise.run(one, motion)[0], hand, FITTED) for one in targets]
    return [reference for one in found for reference in one.references]


def worlds(hand: HandModel, bodies: list[GraspObject], references: list[HandReference], config: GraspImitationConfig,
           count: int) -> GraspImitationWorlds:  # fmt: skip
    """Build worlds that take the tools in turn."""
    tasks = [make_task(body) for body in bodies]
    return GraspImitationWorlds(hand, [tasks[k % len(tasks)] for k in range(count)], references, config)


def prior() -> ActorCritic:
    """Load the shipped prior, with an untrained critic."""
    model, _ = policy_files.read_policy(tree("prior", SHIPPED))
    torch.manual_seed(0)
    model.critic = mlp((model.config.observation, *model.config.hidden, 1), model.config.activation, last=1.0)
    return model


def config(anchor: float, updates: int) -> PriorTrainingConfig:
    """Parameters of hand_imitation without DAgger."""
    p = hand_imitation.Params()
    ppo = PPOConfig(updates=updates, steps=p.steps, lr=p.ppo_lr, target_kl=p.ppo_kl)
    return PriorTrainingConfig(p.seed, 0, p.alone, p.memory, p.passes, p.batch, p.lr, p.nudged, p.noise, p.critic, p.settled,
                               anchor, p.ppo_std, ppo)  # fmt: skip


@torch.no_grad()
def evaluate(core: GraspImitationWorlds, model: ActorCritic) -> list[float]:
    """Compute FIGURES, means over episodes of the policy's mean action."""
    model.eval()
    n, rows = len(core.grasping.tasks), list[list[float]]()
    for number in range(ROUNDS):
        rngs = [np.random.default_rng([5, number, k]) for k in range(n)]
        core.reset(range(n), rngs)
        total = np.zeros(n)
        for _ in range(core.config.steps):
            total += core.step(model.actions(torch.from_numpy(core.observe())).mean.numpy(), rngs).reward
        report = core.report() | {"return": total}
        rows.append([float(np.mean(report[name])) for name in FIGURES])
    return np.mean(rows, axis=0).tolist()


if __name__ == "__main__":
    main()
