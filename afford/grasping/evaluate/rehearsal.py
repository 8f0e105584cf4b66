"""Episodes of a trained policy to look at: one of each of some tasks, in MuJoCo, from where the policy was trained to begin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import rollout
from afford.grasping.env.task import from_grasp_task
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.sim.scene import Physics
from schemas.episodes import GraspTrace
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel

ITERATIONS = 100
"""of the solver, at most"""


def rehearsed(hand: HandModel, tasks: Sequence[GraspTask], files: FileTree, seed: int) -> list[GraspTrace]:
    """One episode of each task, side by side; the policy's mean action. ValueError for files that are no policy."""
    policy = load_policy(files, {})
    grasping = GraspWorlds(hand, [from_grasp_task(one) for one in tasks],
                           policy.config("mujoco", Physics(iterations=ITERATIONS), "flat", 0.0))
    try:
        played = rollout(grasping, policy.actor(grasping), [np.random.default_rng([seed, k]) for k in range(len(tasks))])
    finally:
        grasping.close()
    return [played.trace(k, one.name, 0) for k, one in enumerate(tasks)]


def spread(tasks: Sequence[GraspTask], count: int) -> list[GraspTask]:
    """At most `count` tasks, evenly over all of them."""
    chosen = np.linspace(0, len(tasks) - 1, min(count, len(tasks))).round().astype(int)
    return [tasks[k] for k in dict.fromkeys(chosen.tolist())]
