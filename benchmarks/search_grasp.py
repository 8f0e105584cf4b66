"""Search the parameters of the scripted grasp (grasping/sim/scripted.py) by the cross-entropy method, in MuJoCo, on a few objects.

    PYTHONPATH=. python benchmarks/search_grasp.py

The last line printed is the value of `scripted.GRASP`. Each grasp is tried on every object with a perturbed hand pose, the same
for all grasps of a generation, so that robust grasps win.
"""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import chain

import numpy as np

from afford.grasping.hand.assets import shadow_files
from afford.grasping.sim.engine import World, make_world
from afford.grasping.sim.scene import Physics, Scene
from afford.grasping.sim.scripted import Grasp, grasp_part
from schemas.grasp import GraspObject
from schemas.mesh import ObjectSpec
from stages.grasping import hand_model, object_solids
from stages.synthetic import object_build

OBJECTS = tuple((category, seed) for category in ("hammer", "knife", "screwdriver", "spatula", "chisel") for seed in (1, 2)) + (
    ("knife", 3), ("knife", 4))  # fmt: skip
SEED, POPULATION, ELITE, GENERATIONS = 0, 40, 8, 14
KEEP, FLOOR = 0.3, 0.1
"""share of the old mean and spread in the new; least spread, as a share of the first"""
JITTER_M = 0.003
AT = np.array([0.0, 0.0, 0.002, 0.0, 0.0, 0.0, 1.0])
PINCH = Grasp(grip_m=(0.022, -0.072, 0.108), roll_rad=1.9, yaw_rad=0.05, pitch_rad=0.0, open_base_rad=0.3, open_middle_rad=0.4,
              open_thumb=0.4, base_rad=0.8, middle_rad=0.9, thumb_rad=(0.5, 1.15, 0.0, 0.1, -0.8), sink_m=0.006)  # fmt: skip
"""thumb and fingers opposite each other and pointing down, by kinematics alone: where the first search began"""
START = Grasp(grip_m=(0.0206, -0.0684, 0.1164), roll_rad=1.898, yaw_rad=0.1073, pitch_rad=-0.0196, open_base_rad=0.3422,
              open_middle_rad=0.5596, open_thumb=0.708, base_rad=0.9254, middle_rad=1.0719,
              thumb_rad=(0.4219, 1.2477, 0.1002, 0.1238, -0.5431), sink_m=0.0082)  # fmt: skip
"""where that one ended, on eight objects and from SPREAD; this one begins here, from half of it"""
SPREAD = np.array([0.006, 0.008, 0.008, 0.12, 0.06, 0.05, 0.15, 0.15, 0.25, 0.2, 0.25, 0.12, 0.12, 0.1, 0.15, 0.3, 0.006])


def main() -> None:
    """Search, and print."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    scenes = [Scene(hand, _object(category, seed), Physics(hand_friction=0.8)) for category, seed in OBJECTS]
    worlds = [make_world("mujoco", scene) for scene in scenes]
    rng, mean, spread = np.random.default_rng(SEED), flat(START), 0.5 * SPREAD
    for generation in range(GENERATIONS):
        drawn = mean + spread * rng.standard_normal((POPULATION, len(mean)))
        drawn[0] = mean
        beside = rng.uniform(-JITTER_M, JITTER_M, (len(scenes), 3))
        found = [_score(shaped(row), scenes, worlds, beside) for row in drawn]
        best = drawn[np.argsort([-score for score, _ in found])[:ELITE]]
        mean = KEEP * mean + (1 - KEEP) * best.mean(0)
        spread = np.maximum(KEEP * spread + (1 - KEEP) * best.std(0), FLOOR * SPREAD)
        print(f"{generation:2d}  best {max(score for score, _ in found):.2f}  held by the mean before {found[0][1]:.2f}, "
              f"by all {np.mean([held for _, held in found]):.2f}", flush=True)  # fmt: skip
    print(shaped(np.round(mean, 4)))


def flat(grasp: Grasp) -> np.ndarray:
    """Flatten a grasp to its (17,) parameters."""
    return np.array(list(chain.from_iterable(v if isinstance(v, tuple) else (v,) for v in astuple(grasp))))


def shaped(row: np.ndarray) -> Grasp:
    """A grasp of (17,) numbers."""
    x = [float(number) for number in row]
    return Grasp((x[0], x[1], x[2]), *x[3:11], (x[11], x[12], x[13], x[14], x[15]), x[16])


def _score(grasp: Grasp, scenes: list[Scene], worlds: list[World], beside: np.ndarray) -> tuple[float, float]:
    """Return the objective, and the share of objects that were held."""
    total, held = 0.0, 0
    for scene, made, shift in zip(scenes, worlds, beside, strict=True):
        grip = tuple(np.add(grasp.grip_m, shift).tolist())
        out = grasp_part(made, scene, AT, scene.body.parts.index("handle"), replace(grasp, grip_m=grip))
        deep_mm = 1000 * float(np.percentile(out.penetration_m, 95)) if len(out.penetration_m) else 0.0
        total += out.held + 0.3 * out.gripped - 4 * min(out.away_m, 0.3) - 4 * min(out.shoved_m, 0.1) - 0.05 * deep_mm
        held += out.held
    return total / len(scenes), held / len(scenes)


def _object(category: str, seed: int) -> GraspObject:
    built = object_build.run(ObjectSpec(f"{category}_{seed}", category, seed, "plain", "train"), object_build.Params(atlas_px=64))
    return object_solids.run(built.mesh, built.parts, object_solids.Params(points=256))


if __name__ == "__main__":
    main()
