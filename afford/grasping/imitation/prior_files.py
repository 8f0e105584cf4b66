"""What a prior is trained on, and the policy as files with the facts that whoever runs it must know."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from afford.grasping.env.task import task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.proof import held
from afford.grasping.imitation.rehearse import Rehearsal, Rehearsing
from afford.grasping.rl import saved
from afford.grasping.rl.policy import ActorCritic, PolicyConfig
from afford.training.curves import Point
from afford.training.loop import derive_seed
from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel, HandReference


@dataclass(frozen=True, eq=False)
class Lessons:
    """What is learned from."""

    core: Rehearsing
    facts: dict[str, Any]
    points: list[Point]
    """how many clips there were, and how many are kept"""


def lessons(hand: HandModel, bodies: Sequence[GraspObject], targets: Sequence[GraspTarget], references: Sequence[HandReference],
            config: Rehearsal, proofs: int, engines: Sequence[str], worlds: int, seed: int) -> Lessons:  # fmt: skip
    """Worlds of the objects that clips lift, in turn; in each of the engines they must do so in as many episodes as there are
    `proofs`. ValueError when none does, or a clip has no target.
    """
    of = {one.name: task(one) for one in bodies}
    kept = list(references)
    for engine in engines if proofs else ():
        still = replace(config, engine=engine, shift_m=0.0, astray=(0.0, 0.0, 0.0))
        good: Any = held(hand, list(of.values()), kept, still, proofs, worlds, seed) >= proofs if kept else []
        kept = [one for one, fine in zip(kept, good, strict=True) if fine]
    tasks = [of[name] for name in of if any(one.object_name == name for one in kept)]
    if not kept:
        raise ValueError(f"hand_imitation: expected a clip that lifts its object {proofs} times of {proofs}, got none of "
                         f"{len(references)}; look at how they are made, or ask for fewer proofs")
    core = Rehearsing(hand, [tasks[k % len(tasks)] for k in range(worlds)], kept, config)
    facts = {"role": "prior", "layout": "small", "rates": "prior", "hand": hand.name, "steps": config.steps,
             "lift_m": config.lift_m, "start": "anywhere", "base": "prior", "seed": seed,
             "posture": posture(hand, targets, kept).tolist(), "objects": [one.body.name for one in tasks]}  # fmt: skip
    return Lessons(core, facts, [Point(0, "proof.clips", len(references)), Point(0, "proof.kept", len(kept))])


def posture(hand: HandModel, targets: Sequence[GraspTarget], references: Sequence[HandReference]) -> np.ndarray:
    """(m,) the mean posture that clips begin in, the wrist meant from the place that is grasped. ValueError for a clip without a
    target.
    """
    places = {one.name: Rotation.from_quat(one.object_pose[3:]).apply(np.array(one.T_object_handle[:3, 3]))
              + one.object_pose[:3] for one in targets}  # fmt: skip
    of_motor = commanded_columns(hand.joints)
    rows = list[np.ndarray]()
    for one in references:
        name = one.name.rpartition("_")[0]
        if name not in places:
            raise ValueError(f"{one.name}: expected the name of a target and a number, got none so named "
                             f"among {len(places)} targets")
        rows.append(one.q[0][of_motor] - np.pad(places[name], (0, len(of_motor) - 3)))
    found: np.ndarray = np.mean(rows, axis=0)
    return found


def fresh(core: Rehearsing, hidden: tuple[int, ...], std: float, seed: int) -> ActorCritic:
    """A network whose weights are a function of the seed."""
    torch.manual_seed(derive_seed(seed))
    return ActorCritic(PolicyConfig(core.width, core.motors, hidden, std=std))


def write(root: Path, model: ActorCritic, made: Lessons) -> Path:
    """A new folder with the policy."""
    shutil.rmtree(root, ignore_errors=True)
    saved.write(root, model, made.facts)
    return root
