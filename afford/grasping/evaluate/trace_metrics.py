"""Per-step metrics of a recorded episode, and its key frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.env.measures import TOUCH_N, as_safe_count, as_violation_pct, nearest
from afford.grasping.env.reward import GOAL_M
from afford.grasping.env.scenery import to_world
from afford.grasping.env.task import from_grasp_task
from schemas.episodes import GraspTrace
from schemas.grasp import GraspTask

PHASES = ("begin", "reach", "close", "lift", "end")
"""names of the key frames"""
RAISED_M = 0.01
"""height above the table"""


@dataclass(frozen=True, eq=False)
class TraceMetrics:
    """Metrics of every step of a trace, as in metrics of episodes."""

    centre: np.ndarray
    """(t, 3) centre of mass of the object, m, world"""
    goal_m: np.ndarray
    """(t,) distance from there to the goal"""
    success: np.ndarray
    """(t,) bool: at the goal now or earlier"""
    N_m: np.ndarray
    """(t, f) distance of each fingertip to the nearest true negative point; infinite without such points"""
    as_violation_pct: np.ndarray
    """(t,) percent of fingertips that are unsafe"""
    as_safe_count: np.ndarray
    """(t,) number of safe fingertips"""


def trace_metrics(trace: GraspTrace, task: GraspTask) -> TraceMetrics:
    """Compute the metrics of all steps; ValueError when the task is not that of the trace."""
    if trace.task != task.name:
        raise ValueError(f"trace {trace.name}: expected its task {trace.task}, got {task.name}; give each trace its own task")
    centre = to_world(trace.body, task.body.com_m[None, None])[:, 0]
    goal_m, N_m = np.linalg.norm(centre - trace.goal, axis=1), _to_negative(trace, task)
    return TraceMetrics(centre, goal_m, np.logical_or.accumulate(goal_m < GOAL_M), N_m, as_violation_pct(N_m), as_safe_count(N_m))


def key_frames(trace: GraspTrace, task: GraspTask) -> tuple[int, ...]:
    """Return the steps of PHASES.

    They are the first step; the first contact, or the nearest approach; the last step before the object rises; the step at half of
    its greatest height; the last step. When the object never rises, they are spread evenly after the contact.
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
    """Return (t, f) distances of fingertips to true negative points."""
    points = from_grasp_task(task).N_true
    if not len(points):
        return np.full(trace.tips.shape[:2], np.inf)
    return nearest(trace.tips, to_world(trace.body, points[None]))[0]
