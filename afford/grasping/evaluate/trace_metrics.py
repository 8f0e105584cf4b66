"""What a trace comes to, row by row, and the moments that tell its story."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.env.measures import GOAL_M, TOUCH_N, as_safe_count, as_violation_pct, nearest
from afford.grasping.env.scenery import to_world
from afford.grasping.env.task import from_grasp_task
from schemas.episodes import GraspTrace
from schemas.grasp import GraspTask

PHASES = ("begin", "reach", "close", "lift", "end")
RAISED_M = 0.01
"""off the table"""


@dataclass(frozen=True, eq=False)
class TraceMetrics:
    """The rows of a trace, judged as metrics judge them."""

    centre: np.ndarray
    """(t, 3) centre of mass of the object, m, world"""
    goal_m: np.ndarray
    """(t,) from there to the goal"""
    success: np.ndarray
    """(t,) bool: it was at the goal here or before"""
    N_m: np.ndarray
    """(t, f) from each fingertip to the nearest point that must not be touched, in truth; infinite where there are none"""
    as_violation_pct: np.ndarray
    """(t,) percent of fingertips that are not safe"""
    as_safe_count: np.ndarray
    """(t,) how many are"""


def trace_metrics(trace: GraspTrace, task: GraspTask) -> TraceMetrics:
    """All rows. ValueError for the task of another trace."""
    if trace.task != task.name:
        raise ValueError(f"trace {trace.name}: expected its task {trace.task}, got {task.name}; give each trace its own task")
    centre = to_world(trace.body, task.body.com_m[None, None])[:, 0]
    goal_m, N_m = np.linalg.norm(centre - trace.goal, axis=1), _to_negative(trace, task)
    return TraceMetrics(centre, goal_m, np.logical_or.accumulate(goal_m < GOAL_M), N_m, as_violation_pct(N_m), as_safe_count(N_m))


def key_frames(trace: GraspTrace, task: GraspTask) -> tuple[int, ...]:
    """The rows of PHASES: the first; where the hand first touches (or is nearest); the last before the object is raised; where it
    is half as high as it ever gets; the last. Where it is never raised, they are spread evenly from the touch on.
    """
    rise, last = trace_metrics(trace, task).centre[:, 2], len(trace.q) - 1
    rise = rise - rise[0]
    touches = np.flatnonzero(trace.force.sum(axis=1) > TOUCH_N)
    near = nearest(trace.tips, to_world(trace.body, task.body.points[None].astype(float)))[0].mean(axis=1)
    reach = int(touches[0] if len(touches) else near.argmin())
    raised = np.flatnonzero(rise[reach:] > RAISED_M)
    if not len(raised):
        return (0, reach, *(int(row) for row in np.linspace(reach, last, 4)[1:]))
    lift = reach + int(np.flatnonzero(rise[reach:] >= rise[reach:].max() / 2)[0])
    return 0, reach, min(max(reach, reach + int(raised[0]) - 1), lift), lift, last


def _to_negative(trace: GraspTrace, task: GraspTask) -> np.ndarray:
    """(t, f) distances of fingertips to what must not be touched, in truth."""
    points = from_grasp_task(task).N_true
    if not len(points):
        return np.full(trace.tips.shape[:2], np.inf)
    return nearest(trace.tips, to_world(trace.body, points[None]))[0]
