"""Measure speed and contact depth of both engines in scripted grasps of five kinds of tools; writes benchmarks/physics.md.

    PYTHONPATH=. python benchmarks/bench_physics.py

Times are CPU seconds of one thread. A control step is 1/20 s and includes reading the state; a grasp takes 42 of them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from afford.grasping.hand.assets import shadow_files
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.scene import Physics, Scene
from afford.grasping.sim.scripted import CLOSE, DESCEND, GRASP, HOLD, LIFT, SETTLE, Outcome, grasp_part
from afford.synthetic.splits import TRAINED_CATEGORIES, UNSEEN_CATEGORIES
from schemas.grasp import GraspObject
from schemas.mesh import ObjectSpec
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build

TOOLS = ("hammer", "knife", "screwdriver", "spatula", "chisel")
SEEDS = (11, 12, 13, 14)
"""object seeds that the search for the scripted grasp did not use"""
STEPS = SETTLE + DESCEND + CLOSE + LIFT + HOLD
AT = np.array([0.0, 0.0, 0.002, 0.0, 0.0, 0.0, 1.0])
SETTINGS = (("bullet", Physics(iterations=20)), ("bullet", Physics(iterations=50)), ("bullet", Physics(iterations=100)),
            ("bullet", Physics(iterations=50, rate_hz=480)), ("mujoco", Physics(iterations=50)),
            ("mujoco", Physics(iterations=100)), ("mujoco", Physics(iterations=50, rate_hz=480)))  # fmt: skip


@dataclass(frozen=True, eq=False)
class Row:
    """Result of one setting."""

    outcomes: dict[str, list[Outcome]]
    cpu_s: float
    build_s: float


def main() -> None:
    """Measure, then write."""
    tools = {category: [_object(category, seed) for seed in SEEDS] for category in TOOLS}
    rows = [(engine, physics, _grasp(engine, physics, tools)) for engine, physics in SETTINGS]
    page = Path(__file__).with_name("physics.md")
    page.write_text("\n".join([
        "# Physics", "", "Written by `benchmarks/bench_physics.py`.", "", "## Grasps by script", "",
        f"{len(TOOLS)} kinds of tools x {len(SEEDS)} that the search has not seen. Penetration: deepest contact of hand and object "
        "in each control step in which they touch.", "", _table(rows), "", "## Held, by kind", "", _by_kind(rows), "",
        "## Hulls", "", "One object of each category; how far hulls stand out of it (95th percentile over each hull).", "",
        _hulls(), ""]))


def _grasp(engine: str, physics: Physics, tools: dict[str, list[GraspObject]]) -> Row:
    hand = hand_model.run(shadow_files(), hand_model.Params())
    found: dict[str, list[Outcome]] = {category: [] for category in tools}
    cpu = build = 0.0
    for category, bodies in tools.items():
        for body in bodies:
            scene, start = Scene(hand, body, physics), time.process_time()
            made = make_world(engine, scene)
            middle = time.process_time()
            found[category].append(grasp_part(made, scene, AT, body.parts.index("handle"), GRASP))
            cpu, build = cpu + time.process_time() - middle, build + middle - start
            made.close()
    return Row(found, cpu, build)


def _table(rows: list[tuple[str, Physics, Row]]) -> str:
    lines = ["| engine | Hz | iterations | held | gripped | penetration median / p95 mm | control steps / CPU s | made in s |",
             "|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for engine, physics, row in rows:
        all_of = [out for outs in row.outcomes.values() for out in outs]
        deep = 1000 * np.concatenate([out.penetration_m for out in all_of])
        lines.append(
            f"| {engine} | {physics.rate_hz} | {physics.iterations} | {sum(o.held for o in all_of)} of {len(all_of)} | "
            f"{sum(o.gripped for o in all_of)} | {np.median(deep):.2f} / {np.percentile(deep, 95):.2f} | "
            f"{STEPS * len(all_of) / row.cpu_s:.0f} | {row.build_s / len(all_of):.2f} |")  # fmt: skip
    return "\n".join(lines)


def _by_kind(rows: list[tuple[str, Physics, Row]]) -> str:
    lines = [f"| engine, Hz, iterations | {' | '.join(TOOLS)} |", "|---" + "|--:" * len(TOOLS) + "|"]
    for engine, physics, row in rows:
        cells = (f"{sum(out.held for out in row.outcomes[category])}" for category in TOOLS)
        lines.append(f"| {engine}, {physics.rate_hz}, {physics.iterations} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _hulls() -> str:
    lines = ["| category | parts | hulls | mass kg | stand-out mean mm | worst hull mm | CPU s |", "|---|--:|--:|--:|--:|--:|--:|"]
    for category in sorted((*TRAINED_CATEGORIES, *UNSEEN_CATEGORIES)):
        start = time.process_time()
        body = _object(category, SEEDS[0])
        out = 1000 * body.stand_out_m
        lines.append(f"| {category} | {len(body.parts)} | {len(out)} | {body.mass_kg:.3f} | {out.mean():.1f} | {out.max():.1f} | "
                     f"{time.process_time() - start:.1f} |")  # fmt: skip
    return "\n".join(lines)


def _object(category: str, seed: int) -> GraspObject:
    built = object_build.run(ObjectSpec(f"{category}_{seed}", category, seed, "plain", "train"), object_build.Params(atlas_px=64))
    return object_solids.run(built.mesh, built.parts, object_solids.Params())


if __name__ == "__main__":
    main()
