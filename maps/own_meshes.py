"""Graphs of grasps of the user's meshes: parts and N_t -> bodies and tasks -> a policy, as it is and at tried places -> the report.

Targets: `grasp` with --source; `grasp-adapt`, in which the policy is also adapted to each mesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from maps import grasping, surface
from maps.bodies import Bodies, body_policies, evaluate_bodies, of_last_policy
from maps.common import record_run, reported, shipped
from maps.settings import Origin, Settings
from runner import Graph
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.hand import HandModel
from schemas.surface import PartDescriptions
from schemas.training import TrainingLog
from stages.grasping import body_adapt, body_choose, body_list, body_report, body_tasks
from stages.recording import grasp_record
from stages.surface import part_segment

TRIED = "tried"
"""row of a policy at the places that it tried"""


def add_bodies(g: Graph, origin: Origin, hand: HandModel, p: Settings) -> tuple[Bodies, PartDescriptions]:
    """Find the parts and N_t of the user's meshes, and turn them into bodies with tasks; also the descriptions of their parts."""
    scorer = shipped(g, p, "scorer_train")
    files = surface.mesh_files(g, origin)
    read = surface.read_meshes(g, files, p)
    x = surface.add_meshes(g, read, p)
    scorer = surface.train_scorer(g, p).files(g) if scorer is None else scorer
    seen = surface.add_affordance(g, x, scorer, p)
    parts = g.add(part_segment.run, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates, descriptions=seen.notes,
                  scores=seen.fit, params=p.surface.part_segment)  # fmt: skip
    listed = {"files": files} if poses_listed(origin) else {}
    made = g.add(body_tasks.run, hand=hand, mesh=x.mesh, parts=parts, report=g.pick(read, lambda r: r.report),
                 descriptions=seen.notes, found=seen.found, params=p.grasping.body_tasks, **listed)  # fmt: skip
    names = g.leaf("mesh_names", tuple(FileTree(one.name, ()) for one in origin.meshes))
    return Bodies(names, made, g.add(body_list.run, body=made, params=body_list.Params())), seen.notes


def poses_listed(origin: Origin) -> bool:
    """Test whether some meshes have grasps of UniDexGrasp beside them, which say how an object lies."""
    return any(file.name.endswith(".npz") for one in origin.meshes for file in one.files)


def as_listed(origin: Origin, p: Settings) -> Settings:
    """Settings in which objects whose poses are listed stay in them."""
    return p.with_stages(body_choose=replace(p.grasping.body_choose, turned=False)) if poses_listed(origin) else p


def choose_places(g: Graph, hand: HandModel, bodies: Bodies, described: PartDescriptions, policy: FileTree,
                  p: Settings) -> Bodies:  # fmt: skip
    """Let a policy try places of each task of the user's meshes, and take the best; the bodies as they are for one place each."""
    if p.grasping.body_choose.options == 1:
        return bodies
    made = g.add(body_choose.run, hand=hand, body=bodies.made, descriptions=described, policy=policy,
                 params=p.grasping.body_choose, ctx=g.ctx)  # fmt: skip
    return bodies._replace(made=made, tasks=g.named("tried_list").add(body_list.run, body=made, params=body_list.Params()))


def adapt_bodies(g: Graph, hand: HandModel, bodies: Bodies, policy: FileTree,
                 p: Settings) -> tuple[FileTree, tuple[TrainingLog, ...]]:  # fmt: skip
    """Adapt a teacher to each body; the policy of each, and the curves of all."""
    made = g.add(body_adapt.run, hand=hand, tasks=bodies.tasks, policy=policy, params=p.grasping.body_adapt, ctx=g.ctx)
    files = g.publish(g.pick(made, lambda t: t.files), "models/{source}/{clip}", as_="adapted")
    return files, g.collect(g.pick(made, lambda t: t.log))


def evaluate_tried(g: Graph, hand: HandModel, bodies: Bodies, tried: Bodies, policies: Mapping[str, FileTree],
                   p: Settings) -> list[GraspEpisodes]:  # fmt: skip
    """Evaluate policies at the places that the shapes suggest, and the last of them at the places that were tried."""
    found = evaluate_bodies(g, hand, bodies, policies, p)
    name = list(policies)[-1]
    return found if tried is bodies else [*found, *evaluate_bodies(g, hand, tried, {name: policies[name]}, p, TRIED)]


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


def grasp(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of the meshes of --source by the shipped policy of bodies; without a source, the trainings of maps/grasping.py."""
    if origin.meshes:
        grasp_meshes(g, origin, p)
    else:
        grasping.grasp(g, origin, p)


def grasp_meshes(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of the user's meshes by the shipped policy of bodies, as it is and at tried places, in both engines."""
    hand, policies = body_policies(g, p)
    found, described = add_bodies(g, origin, hand, p)
    tried = choose_places(g, hand, found, described, list(policies.values())[-1], as_listed(origin, p))
    report_bodies(g, "grasp", hand, found, tried, evaluate_tried(g, hand, found, tried, policies, p), p)


def grasp_adapt(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of the meshes of --source by the shipped policy of bodies, as it is, at tried places and adapted, in both engines."""
    hand, policies = body_policies(g, p)
    last = list(policies.values())[-1]
    found, described = add_bodies(g, origin, hand, p)
    tried = choose_places(g, hand, found, described, last, as_listed(origin, p))
    before = evaluate_tried(g, hand, found, tried, policies, p)
    adapted, curves = adapt_bodies(g, hand, tried, last, p)
    after = evaluate_bodies(g, hand, tried, {"adapted": adapted}, p)
    report_bodies(g, "grasp-adapt", hand, found, tried, after, p, before, curves)
