"""One object with two tasks: N_t at either end, and the shift of the grasp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rendering import NEGATIVE, GraspRenderer
from afford.grasping.env.rollout import Actor
from afford.grasping.evaluate.comparisons import pair_figures, pair_lines, pair_metrics, shifts_m
from afford.grasping.evaluate.two_tasks import APART_M, evaluate_task_pairs, long_axis, opposite_end_tasks
from afford.grasping.policies.load_policy import Policy
from afford.grasping.sim.scene import Physics
from schemas.episodes import TwoTasks
from schemas.files import FileTree
from stages.grasping import grasp_two_tasks
from tests.helpers.made_hands import shadow
from tests.helpers.made_samples import Scratch
from tests.helpers.made_scenes import tool

FACTS = {"base": "script", "start": "anywhere", "steps": 44}
FAST = Physics(iterations=50)


class Shy:
    """Policy that moves away from N_t, given the pose of the object."""

    def act(self, now: GraspWorlds) -> np.ndarray:
        points = now.scenery.negative_points(now.state()).mean(axis=1) - now.scenery.centre(now.state())
        x = np.stack([np.cos(now.episode.yaw), np.sin(now.episode.yaw)], axis=1)
        out = np.zeros((len(now.tasks), now.motors))
        out[:, 0] = -0.3 * np.sign((points[:, :2] * x).sum(axis=1)) * (now.steps_done() < 6)
        return out


class FunctionPolicy(Policy):
    """Policy with a given actor."""

    def actor(self, grasping: GraspWorlds) -> Actor:
        return Shy()


def test_ends_of_the_object() -> None:
    """100 points on either side, none within 2 cm of the centre of mass along the object; nothing else differs."""
    body = tool("screwdriver")
    first, other = opposite_end_tasks(body)
    for task, side in ((first, 1), (other, -1)):
        assert task.N_t.shape == (100, 3) and (side * ((task.N_t - body.com_m) @ long_axis(body)) > APART_M).all()
        assert task.negative == () and task.body is body
    short = replace(body, points=(body.points * np.float32(0.01)).astype(np.float32), com_m=body.com_m * 0.01)
    with pytest.raises(ValueError, match="at both ends, got 0 and 0"):
        opposite_end_tasks(short)


def test_a_policy_with_negative_points_shifts_its_grasp() -> None:
    """The base alone plays both episodes with the same bits; Shy moves away by centimetres, both ways."""
    bodies, args = (tool("screwdriver"), tool("spatula")), ("x", "mujoco", FAST, 1, 1, 1, 0, lambda done, total: None)
    blind, _ = evaluate_task_pairs(shadow(), bodies, Policy(FACTS, None, None), *args)
    assert np.array_equal(blind.along_m[:, 0], blind.along_m[:, 1]) and blind.success.any()
    assert shifts_m(blind)[1] == pytest.approx(0.0, abs=0)
    moved, seen = evaluate_task_pairs(shadow(), bodies, FunctionPolicy(FACTS, None, None), *args)
    assert (moved.along_m[:, 1] - moved.along_m[:, 0] > 0.02).all() and len(seen) == 2
    assert [task.name.rpartition("/")[2] for task, _ in seen] == ["first_end", "other_end"]
    assert np.array_equal(seen[0][1].body[0], seen[1][1].body[0]) and np.array_equal(seen[0][1].q[0], seen[1][1].q[0])


def made(along: list[tuple[float, float]], success: list[tuple[int, int]], body: str = "aabc") -> TwoTasks:
    return TwoTasks("x-bullet-0", "teacher", "bullet", 0, tuple(body), np.array(along), np.array(success) > 0)


def test_figures_use_objects_lifted_twice() -> None:
    """a moves by 10 and 30 mm, b by 40, c is dropped once: mean 30 of two objects."""
    pairs = made([(0, 0.01), (-0.01, 0.02), (0, 0.04), (0, 1.0)], [(1, 1), (1, 1), (1, 1), (1, 0)])
    found = pair_figures(pairs)
    assert found["shift_mm"] == pytest.approx(30) and found["objects"] == 2 and found["succ"] == 0.75
    assert found["shift_mm_low"] == pytest.approx(30 - 12.7062 * 10, abs=0.01) and found["away"] == 1
    metrics = pair_metrics([pairs, replace(pairs, engine="mujoco", policy="no_negative")])
    assert metrics["teacher.two_tasks.shift_mm"] == metrics["mujoco.no_negative.two_tasks.shift_mm"] == pytest.approx(30)
    none = made([(0, 0.01)], [(1, 0)], "a")
    assert np.isnan(pair_figures(none)["shift_mm"]) and "| teacher | bullet |  |  |" in pair_lines([none])[-2]
    assert pair_lines([]) == []


def test_stage_draws_both_tasks(tmp_path: Path) -> None:
    """Base alone, small pictures; N_t is drawn in red."""
    params = grasp_two_tasks.Params("no_policy", "mujoco", rounds=1, iterations=20, width=96, height=72, supersample=1)
    task = opposite_end_tasks(tool("screwdriver"))[0]
    no_policy = FileTree("none", ())
    shown = grasp_two_tasks.run(shadow(), (tool("screwdriver"),), no_policy, params, Scratch(tmp_path))
    assert [file.name for file in shown.sheet.files] == ["two_tasks.png"] and shown.pairs.along_m.shape == (1, 2)
    args = (Policy({}, None, None), "x", "mujoco", FAST, 1, 1, 1, 0, lambda done, total: None)
    (_, trace), _ = evaluate_task_pairs(shadow(), (task.body,), *args)[1]
    picture = GraspRenderer(shadow(), task, 160, 120).render(trace, 0).rgb.astype(int)
    red = (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 2 * picture[..., 2])
    assert red.sum() > 10 and NEGATIVE[0] > 2 * NEGATIVE[1]
    with pytest.raises(ValueError, match="no objects to grasp"):
        grasp_two_tasks.run(shadow(), (), no_policy, params, Scratch(tmp_path))
