"""Graph of grasps of household bodies: tools, vessels and packages -> tasks in three poses -> both engines -> the report."""

from __future__ import annotations

from dataclasses import replace

from afford.grasping.evaluate.recipes import TEACHER
from maps.bodies import Bodies, evaluate_bodies
from maps.common import record_run, reported
from maps.grasping import usual_teacher
from maps.settings import Origin, Settings
from runner import Graph
from schemas.hand import HandModel
from stages.grasping import body_list, household_report, household_shown, household_tasks
from stages.recording import grasp_record
from stages.synthetic import household_build, household_plan

TRACES = 9
"""episodes of a body that are recorded step by step: one of each use in each pose"""


def household_bodies(g: Graph, hand: HandModel, p: Settings) -> Bodies:
    """Build household bodies, and derive their tasks with true parts and N_t."""
    spec = g.each(g.add(household_plan.run, params=p.synthetic.household_plan))
    built = g.add(household_build.run, spec=spec, params=p.synthetic.household_build)
    made = g.add(household_tasks.run, hand=hand, mesh=g.pick(built, lambda b: b.mesh), parts=g.pick(built, lambda b: b.parts),
                 params=p.grasping.household_tasks)  # fmt: skip
    return Bodies((), made, g.add(body_list.run, body=made, params=body_list.Params()))


def grasp_household(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of household bodies by the shipped teacher as it is, in both engines, by grasp family and category."""
    hand, policy = usual_teacher(g, p)
    bodies = household_bodies(g, hand, p)
    made, tasks = g.collect(bodies.made), g.collect(bodies.tasks)
    traced = p.with_stages(body_evaluate=replace(p.grasping.body_evaluate, traces=TRACES))
    episodes = evaluate_bodies(g, hand, bodies, policy, TEACHER, traced)
    page = g.add(household_report.run, bodies=made, episodes=g.finished("household_runs", episodes),
                 params=household_report.Params(), ctx=g.ctx)  # fmt: skip
    films = list[object]()
    for engine, one in zip(p.grasping.body_report.engines, episodes, strict=True):
        shown = g.each(g.named(f"shown_{engine}").add(household_shown.run, bodies=made, episodes=one,
                                                      params=p.grasping.household_shown))  # fmt: skip
        film = g.named(f"grasp_record_{engine}").add(grasp_record.run, hand=hand, tasks=tasks, episodes=shown,
                                                     params=p.grasping.grasp_record, ctx=g.ctx)  # fmt: skip
        films.append(g.publish(film, "recordings/{source}/{clip}", as_=f"films_{engine}"))
    g.target("grasp-household", reported(g, page), record_run(g, "household_report", page), *films)
