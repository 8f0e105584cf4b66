"""The verb `run`: damage found while publishing, default time limits, and costs."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from commands.outputs import stage_costs
from commands.run import DEFAULT_MINUTES, Request, run_and_publish, time_limit_s
from maps.settings import Origin, Settings
from pipeline import TARGETS, build
from runner import LostError, RunReport


def _twice(limit_s: float | None, losses: int) -> tuple[list[dict], object]:  # type: ignore[type-arg]  # keywords
    asked: list[dict] = []  # type: ignore[type-arg]

    def ask(**how: object) -> SimpleNamespace:
        asked.append(how)
        return SimpleNamespace(number=len(asked), seconds=40.0)

    def publish(report: SimpleNamespace) -> str:
        if report.number <= losses:
            raise LostError("0" * 64, True, "a blob of it")
        return f"of run {report.number}"

    return asked, run_and_publish(ask, publish, ["frame_decode"], limit_s)  # type: ignore[arg-type]  # a report of two fields


def test_an_intact_output_runs_once() -> None:
    asked, (report, out) = _twice(60.0, losses=0)  # type: ignore[misc]
    assert (report.number, out) == (1, "of run 1") and asked == [{"force": ["frame_decode"], "limit_s": 60.0}]


@pytest.mark.parametrize(("limit_s", "left_s"), [(60.0, 20.0), (30.0, 0.0), (None, None)])
def test_a_damaged_output_runs_again_in_the_remaining_time(limit_s: float | None, left_s: float | None) -> None:
    """The second run forces nothing, and the limit covers both."""
    asked, (report, out) = _twice(limit_s, losses=1)  # type: ignore[misc]
    assert (report.number, out) == (2, "of run 2") and asked[1:] == [{"limit_s": left_s}]


@pytest.mark.parametrize(("asked", "limit_s"), [({}, 75 * 60), ({"minutes": 2.0}, 120), ({"minutes": float("inf")}, None),
                                                ({"only": "sor3d_report"}, None), ({"minutes": 0.0}, 0)])  # fmt: skip
def test_long_targets_have_a_default_time_limit(asked: dict, limit_s: float | None) -> None:  # type: ignore[type-arg]  # keywords
    """`--minutes` overrides it; other targets have none."""
    assert time_limit_s(Request("sor3d-ablation", **asked), "sor3d-ablation") == limit_s
    assert time_limit_s(Request("dataset"), "dataset") is None and set(TARGETS) >= DEFAULT_MINUTES.keys()


def test_repeated_damage_is_an_error() -> None:
    with pytest.raises(LostError):
        _twice(60.0, losses=2)


def test_costs_count_the_steps_of_evaluations_alone() -> None:
    """Followed clips and two-task episodes run in the same engines, but their steps do not count."""
    spent = {"teacher_0_train_bullet": 2.0, "teacher_dropped_0_train_bullet": 3.0, "teacher_0_unseen_object_mujoco": 4.0,
             "followed_train_bullet": 100.0, "followed_unseen_object_mujoco": 100.0, "teacher_0_two_tasks_bullet": 100.0,
             "no_negative_0_two_tasks_mujoco": 100.0, "teacher_0": 100.0}  # fmt: skip
    report = RunReport("grasp-full", cpu_s={(name, ""): cpu for name, cpu in spent.items()})
    graph = build("grasp-full", Origin("grasp-full"), Settings())

    def rates(figures: dict[str, float]) -> dict[str, float]:
        return {name: value for cost in graph.costs for name, value in stage_costs(cost, report, figures).items()}

    both = rates({"control_steps.bullet": 1000.0, "control_steps.mujoco": 1000.0})
    assert both == {"control_steps_per_s": 200.0, "mujoco.control_steps_per_s": 250.0}
    assert rates({"control_steps.mujoco": 1000.0}) == {"mujoco.control_steps_per_s": 250.0}
