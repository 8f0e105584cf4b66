"""Filter reference clips by simulation, and build the worlds and facts that a prior is trained with.

A clip is kept when a hand that only follows it lifts the object and holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.task import Task, make_task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from afford.training.curves import Point
from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel, HandReference


def held_counts(hand: HandModel, tasks: Sequence[Task], references: Sequence[HandReference], config: GraspImitationConfig,
                times: int, worlds: int, seed: int) -> np.ndarray:  # fmt: skip
    """(k,) number of the `times` episodes in which a hand that follows a clip holds the object at the end.

    `worlds` clips are tried at once. ValueError for a clip whose object is not among the tasks.
    """
    of = {one.body.name: one for one in tasks}
    if unknown := sorted({one.object_name for one in references} - set(of)):
        raise ValueError(f"references: expected objects among {', '.join(sorted(of))}, got {', '.join(unknown)}")
    batches = [references[first : first + worlds] for first in range(0, len(references), worlds)]
    return np.concatenate([_held_counts(hand, of, batch, config, times, seed) for batch in batches])


def _held_counts(hand: HandModel, of: dict[str, Task], clips: Sequence[HandReference], config: GraspImitationConfig, times: int,
                 seed: int) -> np.ndarray:  # fmt: skip
    core = GraspImitationWorlds(hand, [of[clip.object_name] for clip in clips], clips, config, alone=True)
    out = np.zeros(len(clips))
    for number in range(times):
        rngs = [np.random.default_rng([seed, number, k]) for k in range(len(clips))]
        core.reset(range(len(clips)), rngs)
        for _ in range(config.steps):
            core.step(core.expert(), rngs)
        out += core.report()["held"]
    core.close()
    return out


@dataclass(frozen=True, eq=False)
class PriorData:
    """Worlds that a prior is trained in, and the facts that are written with it."""

    core: GraspImitationWorlds
    facts: dict[str, Any]
    points: list[Point]
    """number of clips before and after filtering"""


def prior_data(hand: HandModel, bodies: Sequence[GraspObject], targets: Sequence[GraspTarget], references: Sequence[HandReference],
               config: GraspImitationConfig, proofs: int, engines: Sequence[str], worlds: int, seed: int) -> PriorData:  # fmt: skip
    """Build worlds of the objects whose clips pass the filter, in turn.

    A clip passes when the object is held at the end of `proofs` episodes out of `proofs`, in each of the engines; all clips pass
    for 0. ValueError when no clip passes, or a clip has no target.
    """
    of = {one.name: make_task(one) for one in bodies}
    kept = list(references)
    for engine in engines if proofs else ():
        exact = replace(config, engine=engine, shift_m=0.0, astray=(0.0, 0.0, 0.0))
        good: Any = held_counts(hand, list(of.values()), kept, exact, proofs, worlds, seed) >= proofs if kept else []
        kept = [one for one, fine in zip(kept, good, strict=True) if fine]
    tasks = [of[name] for name in of if any(one.object_name == name for one in kept)]
    if not kept:
        raise ValueError(f"hand_imitation: no clip of {len(references)} lifts its object {proofs} times of {proofs}; "
                         "check the clips, or set a lower proofs")
    core = GraspImitationWorlds(hand, [tasks[k % len(tasks)] for k in range(worlds)], kept, config)
    facts = {"role": "prior", "layout": "small", "rates": "prior", "hand": hand.name, "steps": config.steps,
             "lift_m": config.lift_m, "start": "anywhere", "base": "prior", "seed": seed,
             "posture": mean_start_posture(hand, targets, kept).tolist(), "objects": [one.body.name for one in tasks]}  # fmt: skip
    return PriorData(core, facts, [Point(0, "proof.clips", len(references)), Point(0, "proof.kept", len(kept))])


def mean_start_posture(hand: HandModel, targets: Sequence[GraspTarget], references: Sequence[HandReference]) -> np.ndarray:
    """(m,) mean first posture of the clips, the wrist relative to the place of the grasp. ValueError without its target."""
    places = {one.name: Rotation.from_quat(one.object_pose[3:]).apply(np.array(one.T_object_handle[:3, 3]))
              + one.object_pose[:3] for one in targets}  # fmt: skip
    of_motor = commanded_columns(hand.joints)
    rows = list[np.ndarray]()
    for one in references:
        name = one.name.rpartition("_")[0]
        if name not in places:
            raise ValueError(f"{one.name}: a clip is named after its target, <target>_<number>; none of the {len(places)} targets "
                             f"is named {name}")
        rows.append(one.q[0][of_motor] - np.pad(places[name], (0, len(of_motor) - 3)))
    found: np.ndarray = np.mean(rows, axis=0)
    return found
