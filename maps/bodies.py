"""Graph of grasps of the user's meshes: parts and N_t -> bodies and tasks -> a policy, as it is or adapted -> the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from maps import surface
from maps.common import record_run, reported, shipped
from maps.settings import Origin, Settings
from runner import Graph
from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.surface import PartDescriptions
from schemas.training import TrainingLog
from stages.grasping import (
    body_adapt,
    body_choose,
    body_episodes,
    body_evaluate,
    body_list,
    body_refinement,
    body_report,
    body_tasks,
    household_tasks,
)
from stages.recording import grasp_record
from stages.surface import part_segment
from stages.synthetic import household_build, household_plan

TRIED = "tried"
"""row of a policy at the places that it tried"""
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


def add_bodies(g: Graph, origin: Origin, hand: HandModel, p: Settings) -> tuple[Bodies, PartDescriptions]:
    """Find the parts and N_t of the user's meshes, and turn them into bodies with tasks; also the descriptions of their parts."""
    scorer = shipped(g, p, "scorer_train")
    read = surface.read_meshes(g, origin, p)
    x = surface.add_meshes(g, read, p)
    scorer = surface.train_scorer(g, p).files(g) if scorer is None else scorer
    seen = surface.add_affordance(g, x, scorer, p)
    parts = g.add(part_segment.run, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates, descriptions=seen.notes,
                  scores=seen.fit, params=p.surface.part_segment)  # fmt: skip
    made = g.add(body_tasks.run, hand=hand, mesh=x.mesh, parts=parts, report=g.pick(read, lambda r: r.report),
                 descriptions=seen.notes, found=seen.found, params=p.grasping.body_tasks)  # fmt: skip
    names = g.leaf("mesh_names", tuple(FileTree(one.name, ()) for one in origin.meshes))
    return Bodies(names, made, g.add(body_list.run, body=made, params=body_list.Params())), seen.notes


def choose_places(g: Graph, hand: HandModel, bodies: Bodies, described: PartDescriptions, policy: FileTree,
                  p: Settings) -> Bodies:  # fmt: skip
    """Let a policy try places of each task of the user's meshes, and take the best; the bodies as they are for one place each."""
    if p.grasping.body_choose.options == 1:
        return bodies
    made = g.add(body_choose.run, hand=hand, body=bodies.made, descriptions=described, policy=policy,
                 params=p.grasping.body_choose, ctx=g.ctx)  # fmt: skip
    return bodies._replace(made=made, tasks=g.named("tried_list").add(body_list.run, body=made, params=body_list.Params()))


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


def adapt_bodies(g: Graph, hand: HandModel, bodies: Bodies, policy: FileTree,
                 p: Settings) -> tuple[FileTree, tuple[TrainingLog, ...]]:  # fmt: skip
    """Adapt a teacher to each body; the policy of each, and the curves of all."""
    made = g.add(body_adapt.run, hand=hand, tasks=bodies.tasks, policy=policy, params=p.grasping.body_adapt, ctx=g.ctx)
    files = g.publish(g.pick(made, lambda t: t.files), "models/{source}/{clip}", as_="adapted")
    return files, g.collect(g.pick(made, lambda t: t.log))


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


def evaluate_tried(g: Graph, hand: HandModel, bodies: Bodies, tried: Bodies, policies: Mapping[str, FileTree],
                   p: Settings) -> list[GraspEpisodes]:  # fmt: skip
    """Evaluate policies at the places that the shapes suggest, and the last of them at the places that were tried."""
    found = evaluate_bodies(g, hand, bodies, policies, p)
    name = list(policies)[-1]
    return found if tried is bodies else [*found, *evaluate_bodies(g, hand, tried, {name: policies[name]}, p, TRIED)]


def of_last_policy(episodes: list[GraspEpisodes], p: Settings) -> list[GraspEpisodes]:
    """Select the episodes of the last policy, one for each engine, of those of evaluate_bodies."""
    return episodes[-len(p.grasping.body_report.engines) :]


def report_bodies(g: Graph, target: str, hand: HandModel, bodies: Bodies, tried: Bodies, episodes: list[GraspEpisodes],
                  p: Settings, before: list[GraspEpisodes] | None = None,
                  adapted: tuple[TrainingLog, ...] | None = None) -> None:  # fmt: skip
    """Report the episodes of all bodies, film and record them, and set the target.

    Episodes `before` an adaptation are in the report only; `adapted` are its curves. Films are those of the last policy.
    """
    logs = g.leaf("not_adapted", ()) if adapted is None else adapted
    page = g.add(body_report.run, meshes=bodies.names, bodies=g.collect(bodies.made), adapted=logs, tried=g.collect(tried.made),
                 episodes=g.finished("body_runs", [*(before or ()), *episodes]),
                 params=p.grasping.body_report, ctx=g.ctx)  # fmt: skip
    tasks = g.collect(tried.tasks)
    films = [g.named(f"grasp_record_{number}").add(grasp_record.run, hand=hand, tasks=tasks, episodes=one,
                                                   params=p.grasping.grasp_record, ctx=g.ctx)
             for number, one in enumerate(of_last_policy(episodes, p))]  # fmt: skip
    for number, film in enumerate(films):
        g.publish(film, f"recordings/{{source}}/grasps-{number}", as_=f"films_{number}")
    g.target(target, reported(g, page), record_run(g, "body_report", page), *films)
