"""Filter reference clips by simulation, and build the worlds and facts that a prior is trained with.

A clip is kept when a hand that only follows it lifts the object and holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.task import Task, make_task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from afford.grasping.imitation.recorded_clips import is_evaluation_scan
from afford.grasping.motion.clip_rules import report_of
from afford.grasping.sim.engine import check_stage_engine
from afford.training.curves import Point
from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel, HandReference, ProvenClips, ReferenceSet, RetargetReport


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


LIFTS_NOT = "does not lift"
"""reason of a clip that no engine, or not every engine, accepts"""


def proven(hand: HandModel, bodies: Sequence[GraspObject], targets: Sequence[GraspTarget], sets: Sequence[ReferenceSet],
           others: Sequence[RetargetReport], config: GraspImitationConfig, times: int, engines: Sequence[str], worlds: int,
           seed: int) -> ProvenClips:  # fmt: skip
    """Keep the clips of all sets that pass the filter of `prior_data`; verdicts of all clips, and `others`, are in the report.

    ValueError when no clip passes.
    """
    tasks, kept = [make_task(one) for one in bodies], [one for some in sets for one in some.references]
    failed = dict[str, str]()
    for engine in engines if times else ():
        check_stage_engine(engine)
        exact = replace(config, engine=engine, shift_m=0.0, astray=(0.0, 0.0, 0.0), device="cpu")
        counts = held_counts(hand, tasks, kept, exact, times, worlds, seed) if kept else np.zeros(0)
        failed |= {one.name: f"holds its object in {count:.0f} of {times} episodes in {engine}"
                   for one, count in zip(kept, counts, strict=True) if count < times}  # fmt: skip
        kept = [one for one in kept if one.name not in failed]
    if not kept:
        raise ValueError(f"clip_proof: no clip of {len(failed)} lifts its object {times} times of {times}; check the clips")
    verdicts = [verdict for report in (*(some.report for some in sets), *others) for verdict in report.verdicts]
    judged = [replace(one, kept=False, reason=LIFTS_NOT, detail=failed[one.name]) if one.name in failed else one
              for one in verdicts]  # fmt: skip
    references = ReferenceSet(hand.name, tuple(sorted(kept, key=lambda one: one.name)), report_of(hand.name, judged))
    shown, places = {one.object_name for one in kept}, {one.name.rpartition("_")[0] for one in kept}
    return ProvenClips(references, tuple(one for one in bodies if one.name in shown),
                       tuple(one for one in targets if one.name in places))  # fmt: skip


@dataclass(frozen=True, eq=False)
class PriorData:
    """Worlds that a prior is trained in, and the facts that are written with it."""

    core: GraspImitationWorlds
    facts: dict[str, Any]
    points: list[Point]
    """number of clips before and after filtering"""


def prior_data(hand: HandModel, bodies: Sequence[GraspObject], targets: Sequence[GraspTarget], references: Sequence[HandReference],
               config: GraspImitationConfig, proofs: int, engines: Sequence[str], worlds: int, seed: int,
               recorder: FlightRecorder | None = None, arrays: Arrays = NUMPY) -> PriorData:  # fmt: skip
    """Build worlds of the objects whose clips pass the filter, in turn; at least one of every object where clips are fixed.

    A clip passes when the object is held at the end of `proofs` episodes out of `proofs`, in each of the engines; all clips pass
    for 0. ValueError when no clip passes, a clip has no target, or a recorded clip is of a scan for evaluation.
    """
    of = {one.name: make_task(one) for one in bodies}
    kept = list(references)
    if shown := sorted({one.object_name for one in kept if one.name in config.fixed and is_evaluation_scan(one.object_name)}):
        raise ValueError(f"hand_imitation: {', '.join(shown)}: expected no recorded clip of a scan that policies are evaluated on; "
                         "remove these clips")  # fmt: skip
    for engine in engines if proofs else ():
        check_stage_engine(engine)
        exact = replace(config, engine=engine, shift_m=0.0, astray=(0.0, 0.0, 0.0), device="cpu")
        good: Any = held_counts(hand, list(of.values()), kept, exact, proofs, worlds, seed) >= proofs if kept else []
        kept = [one for one, fine in zip(kept, good, strict=True) if fine]
    tasks = [of[name] for name in of if any(one.object_name == name for one in kept)]
    if not kept:
        raise ValueError(f"hand_imitation: no clip of {len(references)} lifts its object {proofs} times of {proofs}; "
                         "check the clips, or set a lower proofs")
    count = max(worlds, len(tasks)) if config.fixed else worlds
    core = GraspImitationWorlds(hand, [tasks[k % len(tasks)] for k in range(count)], kept, config, recorder=recorder, arrays=arrays)
    facts = {"role": "prior", "layout": "small", "rates": "prior", "hand": hand.name, "steps": config.steps,
             "lift_m": config.lift_m, "start": "anywhere", "base": "prior", "seed": seed,
             "posture": start_posture(hand, targets, kept, config.fixed).tolist(),
             "objects": [one.body.name for one in tasks]}  # fmt: skip
    return PriorData(core, facts, [Point(0, "proof.clips", len(references)), Point(0, "proof.kept", len(kept))])


def start_posture(hand: HandModel, targets: Sequence[GraspTarget], references: Sequence[HandReference],
                  fixed: Sequence[str] = ()) -> np.ndarray:  # fmt: skip
    """(m,) first posture of clips, the wrist relative to the place of the grasp, from which a policy begins.

    Clips that are not fixed come from above, and their mean is returned. Recorded hands come from all sides: where all clips are
    fixed, that of the clip with the least distance to all others. ValueError for a clip without its target.
    """
    places = {one.name: Rotation.from_quat(one.object_pose[3:]).apply(np.array(one.T_object_handle[:3, 3]))
              + one.object_pose[:3] for one in targets}  # fmt: skip
    of_motor = commanded_columns(hand.joints)
    rows, free = list[np.ndarray](), [one for one in references if one.name not in fixed]
    for one in free or references:
        name = one.name.rpartition("_")[0]
        if name not in places:
            raise ValueError(f"{one.name}: a clip is named after its target, <target>_<number>; none of the {len(places)} targets "
                             f"is named {name}")
        rows.append(one.q[0][of_motor] - np.pad(places[name], (0, len(of_motor) - 3)))
    if free:
        found: np.ndarray = np.mean(rows, axis=0)
        return found
    away = np.linalg.norm(np.array(rows)[:, None] - np.array(rows), axis=2).sum(axis=1)
    return rows[int(away.argmin())]
