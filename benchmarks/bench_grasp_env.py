"""Write the tables of docs/grasping/grasp-environments.md from the code, with the speed of both engines.

    PYTHONPATH=. python benchmarks/bench_grasp_env.py

Times are CPU seconds of one thread. A control step is 1/20 s and includes observation and reward. Random actions are added to
the scripted grasp, so that hands touch, hold and drop.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from afford.grasping.env import actions as actions_module
from afford.grasping.env import reward
from afford.grasping.env.actions import RATES, rate_table
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.measures import METRICS
from afford.grasping.env.obs_blocks import LAYOUTS, ROLES, obs_blocks
from afford.grasping.env.task import Task, make_task
from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.kinematics import command_limits, commanded_joints
from afford.grasping.imitation import tracking
from afford.grasping.sim.scene import DOMAIN_RANDOMIZATION, Physics
from benchmarks.pages import ROOT, into
from schemas.hand import HandModel
from schemas.mesh import ObjectSpec
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build

PAGE = ROOT / "docs" / "grasping" / "grasp-environments.md"
TOOLS = ("screwdriver", "hammer", "knife", "spatula")
WORLDS, STEPS, EPISODES = 8, 40, 4
SETTINGS = (("mujoco", "small", 50), ("mujoco", "small", 100), ("mujoco", "paper", 50), ("bullet", "small", 20),
            ("bullet", "small", 50), ("bullet", "small", 100))  # fmt: skip


def main() -> None:
    """Write all tables."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    for name, text in {"action": actions(hand), "wrench": wrenches(hand), "observation": observations(),
                       "reward": rewards(), "imitation": imitations(),
                       "report": report(), "random": randomisation(), "speed": speeds(hand)}.items():  # fmt: skip
        into(PAGE, name, Path(__file__).name, text)


def actions(hand: HandModel) -> str:
    """One row for each number of an action: how far it moves its target in a step, and how far it may in all."""
    names = [hand.joints.name[k] for k in commanded_joints(hand.joints)]
    both = {base: rate_table(rates, len(names)) for base, rates in RATES.items()}
    units = ["m" if k < 3 else "rad" for k in range(len(names))]
    rows = [f"| {k} | {name} | {unit} | {both['none'][k, 0]:g} | {both['prior'][k, 0]:g} | {both['script'][k, 0]:g} "
            f"| {both['script'][k, 1]:g} |"
            for k, (name, unit) in enumerate(zip(names, units, strict=True))]  # fmt: skip
    head = ["| | motor | unit | a step, base `none` | a step, base `prior` | a step, base `script` | in all, base `script` |",
            "|--:|---|---|--:|--:|--:|--:|"]
    return "\n".join([*head, *rows, ""])


def wrenches(hand: HandModel) -> str:
    """Return one row for each number of an action of the paper's mode: its full scale, and the source of that scale."""
    names = [hand.joints.name[k] for k in commanded_joints(hand.joints)]
    full, limits = actions_module.wrench_table(command_limits(hand.joints))[:, 0], command_limits(hand.joints)
    rows = ["| | of | unit | a full action | zero is | published |", "|--:|---|---|--:|--:|--:|"]
    for k, name in enumerate(names):
        what = f"force, {'xyz'[k]}" if k < 3 else f"torque, {'xyz'[k - 3]}" if k < 6 else f"target of {name}"
        unit, published = ("N", "833") if k < 3 else ("N m", "1.67") if k < 6 else ("rad", "limits")
        rows.append(f"| {k} | {what} | {unit} | {full[k]:.4g} | {0.0 if k < 6 else limits[k].mean():.4g} | {published} |")
    return "\n".join([*rows, ""])


def observations() -> str:
    """One row for each block of each layout."""
    rows = ["| layout | group | block | numbers | what |", "|---|---|---|--:|---|"]
    for layout, groups in LAYOUTS.items():
        for group, chosen in groups.items():
            rows += [f"| {layout} | {group} | {block.name} | {block.width} | {block.doc} |" for block in chosen]
    widths = ["| layout | " + " | ".join(f"{role} ({' '.join(groups)})" for role, groups in ROLES.items()) + " |",
              "|---|" + "--:|" * len(ROLES)]  # fmt: skip
    for layout in LAYOUTS:
        widths.append(f"| {layout} | " + " | ".join(str(sum(b.width for b in obs_blocks(layout, role))) for role in ROLES) + " |")
    return "\n".join([*rows, "", *widths, ""])


def rewards() -> str:
    """One row for each term: its weight in each set."""
    rows = ["| term | " + " | ".join(reward.REWARDS) + " | what |", "|---|" + "--:|" * len(reward.REWARDS) + "---|"]
    for name, term in reward.TERMS.items():
        rows.append(f"| {name} | {_weights(reward.REWARDS, name)} | {term.doc} |")
    return "\n".join([*rows, ""])


def imitations() -> str:
    """Return the rows of the imitation terms."""
    rows = ["| term | " + " | ".join(tracking.REWARDS) + " | what |", "|---|" + "--:|" * len(tracking.REWARDS) + "---|"]
    for name, term in tracking.TERMS.items():
        rows.append(f"| {name} | {_weights(tracking.REWARDS, name)} | {term.doc} |")
    return "\n".join([*rows, ""])


def report() -> str:
    """One row for each figure."""
    return "\n".join(["| figure | what |", "|---|---|", *(f"| {name} | {what} |" for name, what in METRICS.items()), ""])


def randomisation() -> str:
    """One row for each number of physics that varies."""
    rows = [f"| {name} | {r.low:g} | {r.high:g} | {r.spread} |" for name, r in DOMAIN_RANDOMIZATION.items()]
    return "\n".join(["| of Physics | from | to | spread |", "|---|--:|--:|---|", *rows, ""])


def speeds(hand: HandModel) -> str:
    """Control steps a CPU second."""
    tasks = [tool(category) for category in TOOLS]
    rows = ["| engine | layout | iterations | control steps / CPU s | a reset, ms |", "|---|---|--:|--:|--:|"]
    for engine, layout, iterations in SETTINGS:
        envs = AffordanceGraspVector(WORLDS, hand, tasks, engine=engine, layout=layout, base="script", steps=STEPS,
                                     physics=Physics(iterations=iterations))  # fmt: skip
        envs.reset(seed=0)
        step_s, reset_s = _times(envs)
        envs.close()
        rows.append(f"| {engine} | {layout} | {iterations} | {1 / step_s:.0f} | {1000 * reset_s:.1f} |")
    return "\n".join([*rows, ""])


def _times(envs: AffordanceGraspVector) -> tuple[float, float]:
    """CPU seconds of one world's step, and of one world's reset, once resting poses are known."""
    rng, step_s, reset_s = np.random.default_rng(0), 0.0, 0.0
    for episode in range(EPISODES):
        start = time.process_time()
        envs.reset(seed=episode)
        middle = time.process_time()
        for _ in range(STEPS - 1):
            envs.step(rng.uniform(-0.5, 0.5, (WORLDS, 24)))
        reset_s, step_s = reset_s + middle - start, step_s + time.process_time() - middle
    return step_s / (EPISODES * (STEPS - 1) * WORLDS), reset_s / (EPISODES * WORLDS)


def _weights(tables: Mapping[str, Mapping[str, float]], term: str) -> str:
    return " | ".join(f"{weights[term]:g}" if term in weights else "" for weights in tables.values())


def tool(category: str) -> Task:
    """A procedural tool to be held by its handle."""
    built = object_build.run(ObjectSpec(f"{category}_11", category, 11, "plain", "train"), object_build.Params(atlas_px=64))
    body = object_solids.run(built.mesh, built.parts, object_solids.Params(points=256))
    return make_task(body, [part for part in body.parts if part != "handle"])


if __name__ == "__main__":
    main()
