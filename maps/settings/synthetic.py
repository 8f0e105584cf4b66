"""Parameters of the synthetic sources: kitchen clips, stills, procedural objects, table-top interactions."""

from __future__ import annotations

from dataclasses import dataclass

from stages.synthetic import (
    benchmark_plan,
    household_build,
    household_plan,
    interaction_plan,
    interaction_render,
    object_build,
    object_plan,
    scene_render,
    shift_plan,
    still_render,
    still_sample,
    tool_plan,
    tool_render,
    train_plan,
)


@dataclass(frozen=True)
class Synthetic:
    """Parameters of every stage of the system, by stage."""

    scene_render: scene_render.Params = scene_render.Params()
    train_plan: train_plan.Params = train_plan.Params()
    shift_plan: shift_plan.Params = shift_plan.Params()
    benchmark_plan: benchmark_plan.Params = benchmark_plan.Params()
    still_render: still_render.Params = still_render.Params()
    still_sample: still_sample.Params = still_sample.Params()
    tool_plan: tool_plan.Params = tool_plan.Params()
    tool_render: tool_render.Params = tool_render.Params()
    object_plan: object_plan.Params = object_plan.Params()
    object_build: object_build.Params = object_build.Params()
    household_plan: household_plan.Params = household_plan.Params()
    household_build: household_build.Params = household_build.Params()
    interaction_plan: interaction_plan.Params = interaction_plan.Params()
    interaction_render: interaction_render.Params = interaction_render.Params()
