"""Meshes of the user as bodies to grasp."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspTask
from schemas.spec import Schema, value


@dataclass(frozen=True)
class BodyTasks(Schema):
    """Grasp tasks of one mesh, and remarks on it; tasks and refusals together are its uses."""

    name: str = value("id of the object")
    tasks: tuple[GraspTask, ...] = value("tasks that a hand can do; each has the body in the pose in which it is laid")
    family: tuple[str, ...] = value("grasp family of each task, afford/grasping/env/families.py FAMILIES")
    refused: tuple[str, ...] = value("a sentence for each use that is no task, or for the whole object")
    notes: tuple[str, ...] = value("what was assumed or repaired, a sentence each")
