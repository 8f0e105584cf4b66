"""Map of the synthetic sources: rendered clips, stills for training and stills for the benchmark."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from maps.common import record_run
from maps.settings import Origin, Settings
from runner import Graph
from schemas.affordance import Samples
from schemas.files import FileTree
from schemas.scene import RenderedClip
from stages.extraction import dataset_pack
from stages.synthetic import (
    benchmark_plan,
    object_build,
    scene_render,
    shift_plan,
    still_render,
    still_sample,
    tool_plan,
    tool_render,
    train_plan,
)
from stages.twohands import benchmark_set


def videos(g: Graph, origin: Origin, p: Settings) -> RenderedClip:
    """Add every video with its files and its ground truth."""
    if origin.specs:
        return g.add(scene_render.run, spec=g.each(g.leaf("specs", origin.specs)), params=p.synthetic.scene_render, ctx=g.ctx)
    return g.each(g.leaf("videos", origin.videos))


def stills_to_train(g: Graph, p: Settings) -> FileTree:
    """Add the training data set of rendered stills."""
    rooms   = g.add(train_plan.run,                                                                  params=p.synthetic.train_plan)
    if p.synthetic.shift_plan.rooms:
        rooms = g.add(shift_plan.run, rooms=rooms,                                                   params=p.synthetic.shift_plan)
    spec    = g.each(rooms)
    stills  = g.add(still_render.run,       spec=spec,       params=p.synthetic.still_render, ctx=g.ctx, **surfaces(g, p))
    samples = g.add(still_sample.run,       stills=stills,                                          params=p.synthetic.still_sample)
    alone: dict[str, Any] = {"more": tools_alone(g, p)} if p.synthetic.tool_plan.per_category else {}
    params  = replace(p.extraction.dataset_pack, name="afford-stills", license="apache-2.0", made="rendered")
    return g.named("train_pack").add(dataset_pack.run, samples=g.collect(samples), params=params, ctx=g.ctx, **alone)


def tools_alone(g: Graph, p: Settings) -> tuple[Samples, ...]:
    """Add samples of objects alone on tables, painted as the rooms are."""
    spec    = g.each(g.add(tool_plan.run,                                                          params=p.synthetic.tool_plan))
    built   = g.named("tool_build").add(object_build.run, spec=spec,                              params=p.synthetic.object_build)
    mesh, parts = g.pick(built, lambda b: b.mesh), g.pick(built, lambda b: b.parts)
    stills  = g.add(tool_render.run,        spec=spec, mesh=mesh, parts=parts, params=p.synthetic.tool_render, ctx=g.ctx,
                    **surfaces(g, p, "tool_render"))
    samples = g.named("tool_sample").add(still_sample.run, stills=stills,                          params=p.synthetic.still_sample)
    return g.collect(samples)


def stills_to_measure(g: Graph, p: Settings) -> FileTree:
    """Add the benchmark of rendered stills of held-out objects and rooms, with masks at 855 px width."""
    spec    = g.each(g.add(benchmark_plan.run,                                                   params=p.synthetic.benchmark_plan))
    params  = replace(p.synthetic.still_render, mask_scale=855 / p.synthetic.still_render.width_px)
    stills  = g.named("benchmark_render").add(still_render.run, spec=spec, params=params, ctx=g.ctx, **surfaces(g, p))
    return g.add(benchmark_set.run,         stills=g.collect(stills),                 params=p.twohands.benchmark_set, ctx=g.ctx)


def surfaces(g: Graph, p: Settings, stage: str = "still_render") -> dict[str, FileTree]:
    """Photographs of surfaces for Cycles, where a stage has any."""
    found = dict(p.weights).get(stage)
    return {"photographs": g.leaf(f"{stage}_photographs", found)} if found else {}


def scenes(g: Graph, origin: Origin, p: Settings) -> None:
    """Rendered clips, as EPIC-format files with ground truth."""
    video = videos(g, origin, p)
    parts = (g.pick(video, lambda v: v.files), g.pick(video, lambda v: v.truth)) if origin.specs else ()
    for part, folder in zip(parts, ("files", "truth"), strict=False):
        g.publish(part, f"scenes/{{source}}/{{clip}}/{folder}", as_="scenes")
    g.target("scenes", video, *parts)


def train_set(g: Graph, origin: Origin, p: Settings) -> None:
    """Rendered stills with exact labels, packed for training."""
    packed = g.publish(stills_to_train(g, p), "datasets/{source}", as_="dataset")
    g.target("train-set", packed, record_run(g, "train_pack", packed))


def benchmark_stills(g: Graph, origin: Origin, p: Settings) -> None:
    """Rendered stills of held-out objects and rooms, in ActAffordance's folders."""
    g.target("benchmark-set", g.publish(stills_to_measure(g, p), "benchmarks/{source}", as_="benchmark"))
