"""A plan: the same walk as a run, but nothing is made; what depends on something unmade is pending."""

from __future__ import annotations

from runner.desk import Desk, Path_, Task
from runner.graph import Node
from runner.report import Reason, TaskPlan
from runner.walk import UNKNOWN, Walk


class Planner:
    """The listener of a walk that only writes down."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self.plans: list[TaskPlan] = []
        self.tasks: dict[tuple[str, str], Task] = {}
        self.walk: Walk

    def cached(self, task: Task, output: str) -> None:
        """It is there; say why it ran the last time."""
        trace = self._desk.traces.get(task.key)
        why, _, detail = (trace.reason if trace else "first run").partition(": ")
        self._add(task, "cached", Reason(why, detail), output)  # type: ignore[arg-type]

    def needed(self, task: Task, reason: Reason) -> None:
        """It would run."""
        self._add(task, "run", reason)
        self.walk.publish(task.node, task.path, UNKNOWN)

    def blocked(self, node: Node, path: Path_, cause: str) -> None:
        """Nothing fails in a plan."""
        raise AssertionError(f"{node.name} {path}: {cause} failed in a plan")

    def left(self, node: Node, path: Path_) -> None:
        """Nothing is left in a plan."""
        raise AssertionError(f"{node.name} {path} was left in a plan")

    def pending(self, node: Node, path: Path_) -> None:
        """It may run, or not, according to what comes out above."""
        self.plans.append(TaskPlan(node.name, "/".join(path), "pending", Reason("upstream pending")))

    def _add(self, task: Task, status: str, reason: Reason, output: str = "") -> None:
        self.tasks[task.node.name, task.shard] = task
        self.plans.append(TaskPlan(task.node.name, task.shard, status, reason, task.key, output))  # type: ignore[arg-type]
