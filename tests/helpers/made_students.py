"""Small students and their worlds for tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from afford.common.files import tree
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import obs_blocks
from afford.grasping.env.task import Task, make_task
from afford.grasping.policies.load_policy import ENVIRONMENT
from afford.grasping.rl import policy_files
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from schemas.files import FileTree
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts
from stages.grasping import object_solids
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_meshes import as_object
from tests.helpers.made_scenes import FEW


def worlds(*tasks: Task, seed: int = 0, **config: Any) -> GraspWorlds:
    """Episodes that have begun."""
    core = GraspWorlds(shadow(), tasks or (held_by_handle(), held_by_handle("screwdriver")), GraspEnvConfig(**config))
    core.reset(range(len(core.tasks)), rngs(core, seed))
    return core


def rngs(core: GraspWorlds, seed: int = 0) -> list[np.random.Generator]:
    """One for each world."""
    return [np.random.default_rng([seed, k]) for k in range(len(core.tasks))]


def put(core: GraspWorlds, **state: np.ndarray) -> None:
    """Replace fields of the state, as if the engine had reported them."""
    core._state = replace(core.state(), **state)  # type: ignore[arg-type]  # fields of State


def crumb() -> Task:
    """A cube of 1 cm, which fits into the palm; its upper half must not be touched."""
    mesh = as_object(trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation((0, 0, 0.005)).subdivide(), "crumb")
    upper = mesh.vertices[mesh.faces][:, :, 2].mean(axis=1) > 0.005
    body: GraspObject = object_solids.run(mesh, MeshParts("crumb", ("foot", "top"), upper.astype(np.int16)), FEW)
    return make_task(body, ("top",))


def teacher(folder: Path, **facts: Any) -> FileTree:
    """Files of an untrained teacher."""
    torch.manual_seed(0)
    config = GraspEnvConfig(**{"start": "anywhere", "base": "script", **facts})
    width = sum(block.width for block in obs_blocks(config.layout, "teacher"))
    known = {name: getattr(config, name) for name in ENVIRONMENT}
    policy_files.write_policy(folder, ActorCritic(PolicyConfig(width, 24, (16,))), known)
    return tree("teacher", folder)
