"""Bodies to grasp: household bodies with their tasks, the policies for bodies, and their evaluation in both engines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from afford.grasping.evaluate.recipes import TEACHER
from maps import grasping
from maps.common import shipped
from maps.settings import Settings
from runner import Graph
from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from stages.grasping import body_episodes, body_evaluate, body_list, body_refinement, household_tasks
from stages.synthetic import household_build, household_plan

BODIES = "bodies"
"""name of the teacher that was trained further on household bodies"""
LESSON_USES = 2
"""uses of each household body that a policy is trained on, at most: others of the same part have the same place"""


class Bodies(NamedTuple):
    """Handles of the meshes of a source as bodies to grasp."""

    names: tuple[FileTree, ...]
    """of all meshes, without files"""
    made: BodyTasks
    """of each mesh that was read"""
    tasks: tuple[GraspTask, ...]
    """of each mesh that was read"""


def household_bodies(g: Graph, hand: HandModel, p: Settings, prefix: str = "") -> Bodies:
    """Build household bodies, and derive their tasks with true parts and N_t; `prefix` of the names of the stages."""
    spec = g.each(g.named(f"{prefix}household_plan").add(household_plan.run, params=p.synthetic.household_plan))
    built = g.named(f"{prefix}household_build").add(household_build.run, spec=spec, params=p.synthetic.household_build)
    made = g.named(f"{prefix}household_tasks").add(household_tasks.run, hand=hand, mesh=g.pick(built, lambda b: b.mesh),
                                                   parts=g.pick(built, lambda b: b.parts),
                                                   params=p.grasping.household_tasks)  # fmt: skip
    return Bodies((), made, g.named(f"{prefix}body_list").add(body_list.run, body=made, params=body_list.Params()))


def refine_teacher(g: Graph, hand: HandModel, teacher: FileTree, p: Settings) -> FileTree:
    """Train a teacher further on household bodies of the split train, which has no held-out category."""
    uses = min(LESSON_USES, p.grasping.household_tasks.uses)
    lessons = p.with_stages(household_plan=replace(p.synthetic.household_plan, splits=("train",)),
                            household_tasks=replace(p.grasping.household_tasks, uses=uses))  # fmt: skip
    tasks = household_bodies(g, hand, lessons, "lesson_").tasks
    made = g.add(body_refinement.run, hand=hand, tasks=g.collect(tasks), policy=teacher, params=p.grasping.body_refinement,
                 ctx=g.ctx)  # fmt: skip
    return g.publish(g.pick(made, lambda t: t.files), "models/{source}-bodies", as_="refined")


def body_policies(g: Graph, p: Settings) -> tuple[HandModel, dict[str, FileTree]]:
    """Robot hand, and the policies of `body_report.policies` for bodies; those that are not shipped are trained.

    ValueError for another name.
    """
    wanted = p.grasping.body_report.policies
    if not wanted or set(wanted) - {TEACHER, BODIES}:
        raise ValueError(f"body_report.policies: expected some of {TEACHER}, {BODIES}, got {', '.join(wanted) or 'none'}")
    refined = shipped(g, p, "body_refinement") if BODIES in wanted else None
    if wanted == (BODIES,) and refined is not None:
        return grasping.robot_hand(g, p), {BODIES: refined}
    hand, teacher = grasping.usual_teacher(g, p)
    if BODIES in wanted and refined is None:
        refined = refine_teacher(g, hand, teacher, p)
    known = {TEACHER: teacher, BODIES: refined}
    return hand, {name: policy for name in wanted if (policy := known[name]) is not None}


def evaluate_bodies(g: Graph, hand: HandModel, bodies: Bodies, policies: Mapping[str, FileTree], p: Settings,
                    row: str = "") -> list[GraspEpisodes]:  # fmt: skip
    """Evaluate policies by name on every body; handles of the episodes of all bodies, one for each policy and engine.

    `row` is the name of one policy in tables, where it is not its own.
    """
    out = list[GraspEpisodes]()
    for (name, policy), engine in product(policies.items(), p.grasping.body_report.engines):
        shown = row or name
        each = g.named(f"{shown}_{engine}").add(body_evaluate.run, hand=hand, tasks=bodies.tasks, policy=policy,
                                                params=replace(p.grasping.body_evaluate, policy=name, engine=engine), ctx=g.ctx)
        out.append(g.named(f"{shown}_{engine}_episodes").add(body_episodes.run, episodes=g.collect(each),
                                                             params=body_episodes.Params(shown)))  # fmt: skip
    return out


def of_last_policy(episodes: list[GraspEpisodes], p: Settings) -> list[GraspEpisodes]:
    """Select the episodes of the last policy, one for each engine, of those of evaluate_bodies."""
    return episodes[-len(p.grasping.body_report.engines) :]
