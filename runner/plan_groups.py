"""Tasks of a plan, grouped by stage, state and reason."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from runner.report import TaskPlan

FIRST = 3
"""shards that a group names"""


@dataclass
class PlanGroup:
    """Tasks of one stage with the same state and reason."""

    stage: str
    status: str
    """cached, run, pending or blocked"""
    reason: str
    count: int = 0
    shards: list[str] = field(default_factory=list)
    """the first ones"""


def group_plans(plans: Iterable[TaskPlan]) -> list[PlanGroup]:
    """Groups in the order of their first task."""
    groups: dict[tuple[str, str, object], PlanGroup] = {}
    for plan in plans:
        group = groups.get((plan.stage, plan.status, plan.reason))
        if group is None:
            group = groups[plan.stage, plan.status, plan.reason] = PlanGroup(plan.stage, plan.status, str(plan.reason))
        group.count += 1
        if len(group.shards) < FIRST:
            group.shards.append(plan.shard)
    return list(groups.values())
