"""Graph of grasps of household bodies: tools, vessels and packages -> tasks in three poses -> both engines -> the report."""

from __future__ import annotations

from dataclasses import replace

from maps.bodies import body_policies, evaluate_bodies, household_bodies, of_last_policy
from maps.common import record_run, reported
from maps.settings import Origin, Settings
from runner import Graph
from stages.grasping import household_report, household_shown
from stages.recording import grasp_record

TRACES = 9
"""episodes of a body that are recorded step by step: one of each use in each pose"""


def grasp_household(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of household bodies by the shipped policies, in both engines, by grasp family and category; films of the last one."""
    hand, policies = body_policies(g, p)
    bodies = household_bodies(g, hand, p)
    made, tasks = g.collect(bodies.made), g.collect(bodies.tasks)
    traced = p.with_stages(body_evaluate=replace(p.grasping.body_evaluate, traces=TRACES))
    episodes = evaluate_bodies(g, hand, bodies, policies, traced)
    page = g.add(household_report.run, bodies=made, episodes=g.finished("household_runs", episodes),
                 params=household_report.Params(), ctx=g.ctx)  # fmt: skip
    films = list[object]()
    for engine, one in zip(p.grasping.body_report.engines, of_last_policy(episodes, p), strict=True):
        shown = g.each(g.named(f"shown_{engine}").add(household_shown.run, bodies=made, episodes=one,
                                                      params=p.grasping.household_shown))  # fmt: skip
        film = g.named(f"grasp_record_{engine}").add(grasp_record.run, hand=hand, tasks=tasks, episodes=shown,
                                                     params=p.grasping.grasp_record, ctx=g.ctx)  # fmt: skip
        films.append(g.publish(film, "recordings/{source}/{clip}", as_=f"films_{engine}"))
    g.target("grasp-household", reported(g, page), record_run(g, "household_report", page), *films)
