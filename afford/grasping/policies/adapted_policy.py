"""Adapted policy of one body: the files of the teacher as it was, and in a folder a network that acts in some of the tasks.

The network has whole actions, without the prior. In the other tasks of the body, and for readers that do not look into the folder,
the policy is the teacher.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from afford.common.files import empty_folder
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.env.rollout import Actor
from afford.grasping.policies.load_policy import MeanAction, Policy, prior_columns
from afford.grasping.rl.policy_files import CONFIG, read_policy, write_policy
from afford.grasping.rl.ppo import ActorCritic
from schemas.files import FileTree

FOLDER = "adapted/"
"""folder of the network within the files"""
TASKS = "tasks"
"""fact of the network: names of the tasks in which it acts"""


class ByTask:
    """Actor that applies one of two actors in each world."""

    def __init__(self, adapted: Actor, before: Actor, chosen: np.ndarray) -> None:
        self.adapted, self.before, self.chosen = adapted, before, chosen

    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m) actions within -1..1."""
        return np.where(self.chosen[:, None], self.adapted.act(now), self.before.act(now))


def write_adapted(root: Path, files: FileTree, model: ActorCritic, policy: Policy, tasks: Sequence[str]) -> Path:
    """Write the files of a teacher and the network for some tasks into the folder `root`, which is emptied."""
    empty_folder(root)
    for file in files.files:
        (root / file.name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file.path, root / file.name)
    write_policy(root / FOLDER, model, {**policy.facts, TASKS: list(tasks)})
    return root


def actor_by_task(files: FileTree, policy: Policy, worlds: PlacedWorlds) -> Actor:
    """Actor of a policy in worlds with tasks; its own where the files have no adapted network."""
    before = policy.actor(worlds)
    if files.find(FOLDER + CONFIG) is None:
        return before
    network, facts = read_policy(files, FOLDER)
    chosen = np.isin([task.name for task in worlds.given], facts[TASKS])
    return ByTask(MeanAction(network, None, prior_columns(worlds.config.layout, worlds.config.role)), before, chosen)
