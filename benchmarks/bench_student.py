"""Write the tables of docs/grasping/student.md: network sizes, depth noise, and the cost of rendering and acting.

    PYTHONPATH=. python benchmarks/bench_student.py

Times are CPU milliseconds of one thread for one world and one control step, in the middle of scripted grasps.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import obs_blocks
from afford.grasping.env.task import make_task
from afford.grasping.hand.assets import shadow_files
from afford.grasping.policies import depth_cameras, student_obs
from afford.grasping.policies.depth_cameras import RANDOM_DEPTH, CameraRig, render_depth
from afford.grasping.policies.student import StudentObserver, StudentSensors
from afford.grasping.policies.student_obs import CloudSampling
from afford.grasping.policies.train_student import new_student
from afford.grasping.rl.estimating_policy import LAYOUT, MeanNetwork, TeacherCopy
from afford.grasping.rl.ppo import PolicyConfig
from benchmarks.pages import ROOT, into
from schemas.mesh import ObjectSpec
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build

PAGE = ROOT / "docs" / "grasping" / "student.md"
TOOLS = ("screwdriver", "hammer", "knife", "spatula")
BEFORE, REPEAT = 16, 5
SETTINGS = (("small", "teacher", StudentSensors()),
            ("small", "teacher", StudentSensors(eyes=CloudSampling(sampling="farthest"))),
            ("small", "own", StudentSensors()),
            ("paper", "own", StudentSensors(depth_cameras.PAPER, CloudSampling(1024, "even", "paper"))),
            ("paper", "own", StudentSensors(depth_cameras.PAPER, student_obs.PAPER)))  # fmt: skip


def main() -> None:
    """Write."""
    torch.set_num_threads(1)
    core = grasps()
    for name, text in {"sizes": sizes(core), "noise": noise(), "cost": costs(core)}.items():
        into(PAGE, name, Path(__file__).name, text)
    core.close()


def grasps() -> GraspWorlds:
    """Hands that have closed."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    built = [object_build.run(ObjectSpec(one, one, 12, "plain", "train"), object_build.Params(atlas_px=64)) for one in TOOLS]
    bodies = [object_solids.run(one.mesh, one.parts, object_solids.Params()) for one in built]
    core = GraspWorlds(hand, [make_task(body, [part for part in body.parts if part != "handle"]) for body in bodies],
                       GraspEnvConfig(base="script"))
    rngs = [np.random.default_rng(k) for k in range(len(TOOLS))]
    core.reset(range(len(TOOLS)), rngs)
    for _ in range(BEFORE):
        core.step(np.zeros((len(TOOLS), core.motors)), rngs)
    return core


def sizes(core: GraspWorlds) -> str:
    """Return the sizes of both networks."""
    rows = ["| size | head | numbers of the robot | points | token | blocks | heads | dropout | perceptron | trained weights |",
            "|---|---|--:|---|--:|--:|--:|--:|---|--:|"]  # fmt: skip
    for size, head, layout in (("small", "teacher", "small"), ("small", "own", "small"), ("paper", "own", "paper")):
        model = new_student(size, _robot_width(core, layout), core.motors, 0, untrained_copy(core, head))
        c = model.config
        rows.append(f"| {size} | {head} | {c.robot} | {', '.join(map(str, c.points))} | {c.width} | {c.blocks} | {c.heads} "
                    f"| {c.dropout:g} | {', '.join(map(str, c.hidden))} "
                    f"| {sum(p.numel() for p in model.parameters() if p.requires_grad):,} |")
    return "\n".join([*rows, ""])


def untrained_copy(core: GraspWorlds, head: str) -> TeacherCopy | None:
    """Networks of the sizes of a teacher and its prior; None for a head of the student's own."""
    if head == "own":
        return None
    teacher, prior = (MeanNetwork(PolicyConfig(sum(block.width for block in obs_blocks(LAYOUT, role)), core.motors))
                      for role in ("teacher", "prior"))  # fmt: skip
    return TeacherCopy(teacher, prior, core.rates[:, 0])


def _robot_width(core: GraspWorlds, layout: str) -> int:
    """Width of the robot's own numbers in a layout."""
    sensors = StudentSensors(CameraRig(1, 16), CloudSampling(16, layout=layout))
    return int(StudentObserver(core, sensors).observe().robot.shape[1])


def noise() -> str:
    """Return the ranges that differ between worlds."""
    rows = [f"| {name} | {span.low:g} | {span.high:g} | {span.spread} |" for name, span in RANDOM_DEPTH.items()]
    return "\n".join(["| of DepthNoise | from | to | spread |", "|---|--:|--:|---|", *rows, ""])


def costs(core: GraspWorlds) -> str:
    """Pictures, clouds, network."""
    rows = ["| views | pixels | points | sampling | size | head | pictures | observation | network | in all |",
            "|--:|--:|--:|---|---|---|--:|--:|--:|--:|"]  # fmt: skip
    for size, head, senses in SETTINGS:
        look, state = StudentObserver(core, senses), core.state()
        seen = [torch.from_numpy(part) for part in look.observe()]
        model = new_student(size, seen[0].shape[1], core.motors, 0, untrained_copy(core, head)).eval()
        pictures = cost(lambda look=look, state=state: render_depth(look.cameras, look.hand, look.bodies, state.q, state.body))
        everything, network = cost(look.observe), cost(lambda model=model, seen=seen: model(*seen))
        rig, eyes = senses.rig, senses.eyes
        rows.append(f"| {rig.views} | {rig.size_px} | {eyes.points} | {eyes.sampling} | {size} | {head} | {pictures:.1f} "
                    f"| {everything:.1f} | {network:.1f} | {everything + network:.1f} |")
    return "\n".join([*rows, ""])


@torch.no_grad()
def cost(act: Callable[[], object]) -> float:
    """CPU ms for each world, the best of several."""
    act()
    found = []
    for _ in range(REPEAT):
        start = time.process_time()
        act()
        found.append(time.process_time() - start)
    return 1000 * min(found) / len(TOOLS)


if __name__ == "__main__":
    main()
