"""Compare success of the shipped teacher in MuJoCo and in mujoco-warp from the same starts; writes benchmarks/engines_paired.md.

    PYTHONPATH=. python benchmarks/bench_engines_paired.py [--starts 256] [--device cpu] [--processes 1]

A start is an object, its place and yaw, and the place of the hand, all drawn from the seed; both engines get the same. Physics are
those of evaluations (100 iterations, 480 Hz). A second run of MuJoCo, with fewer worlds at once, says what a batch size alone
changes: the policy's floats are rounded otherwise. In a third, every pair of shapes has one contact at most: mujoco-warp does not
find all of the others. Needs the extra `gpu`; on a CPU the first run compiles kernels for minutes.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import mujoco
import numpy as np
from scipy.stats import binomtest

from afford.common.files import tree
from afford.common.statistics import bootstrap_interval, wilson_interval
from afford.grasping.env import default
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import rollout
from afford.grasping.env.task import Task, from_grasp_task
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.sim import mujoco_world
from afford.grasping.sim.scene import STRICT, Scene
from benchmarks.bench_grasp_env import tool
from benchmarks.pages import ROOT
from schemas.mesh import ObjectSpec
from stages.grasping import grasp_tasks

PAGE = ROOT / "benchmarks" / "engines_paired.md"
TOOLS = ("screwdriver", "knife", "spatula", "chisel")
"""categories of the procedural tools"""
AT_ONCE, FEWER, SEED, RESAMPLES = 64, 16, 20271, 10_000
FIGURES = ("success", "held")
RUNS = {"warp": ("warp", AT_ONCE), "MuJoCo": ("mujoco", AT_ONCE), f"MuJoCo, {FEWER} at once": ("mujoco", FEWER),
        (SINGLE := "MuJoCo, one contact"): ("mujoco", AT_ONCE)}  # fmt: skip
"""engine and worlds at once of each run"""


def main() -> None:
    """Play all starts in both engines, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=256)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--processes", type=int, default=1, help="runs side by side")
    args = parser.parse_args()
    tasks = [grasp_task(category) for category in TOOLS]
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        runs = {name: pool.submit(play, name, tasks, args.starts, args.device) for name in RUNS}
        found = {name: run.result() for name, run in runs.items()}
    PAGE.write_text("\n".join(page(found, args.device)))


def grasp_task(category: str) -> Task:
    """Task of a tool by its handle, with N_t of its other parts."""
    spec = ObjectSpec(f"{category}_11", category, 11, "plain", "train")
    return from_grasp_task(grasp_tasks.run(spec, tool(category).body, grasp_tasks.Params(within_m=1.0))[0])


def play(name: str, tasks: list[Task], starts: int, device: str) -> dict[str, np.ndarray]:
    """Play the shipped teacher: its figures (n,) by name, and the numbers `diverged` and `seconds`."""
    (engine, at_once), policy = RUNS[name], load_policy(tree("teacher", ROOT / "weights" / "grasp-teacher"), {})
    config = replace(policy.config(engine, STRICT, "flat", 0.0), device=device if engine == "warp" else "cpu")
    out, began, compiled = list[dict[str, np.ndarray]](), time.perf_counter(), mujoco_world.compiled

    def single(scene: Scene) -> mujoco.MjModel:
        model = compiled(scene)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
        return model

    with TemporaryDirectory() as scratch, patch.object(mujoco_world, "compiled", single if name == SINGLE else compiled):
        recorder = FlightRecorder(Path(scratch), engine, SEED)
        worlds = GraspWorlds(default.hand(), [tasks[k % len(tasks)] for k in range(at_once)], config, recorder)
        for first in range(0, starts, at_once):
            rngs = [np.random.default_rng([SEED, *divmod(k, AT_ONCE)]) for k in range(first, first + at_once)]
            out.append(rollout(worlds, policy.actor(worlds), rngs).report)
            means = {name: out[-1][name].mean() for name in FIGURES}
            print(name, first, means, round(time.perf_counter() - began), flush=True)
        worlds.close()
    spent = {"diverged": np.array(recorder.count), "seconds": np.array(time.perf_counter() - began)}
    return {name: np.concatenate([row[name] for row in out]) for name in out[0]} | spent


def page(found: dict[str, dict[str, np.ndarray]], device: str) -> list[str]:
    """Lines of the page."""
    one = found["MuJoCo"]
    pairs = [("MuJoCo", name) for name in found if name != "MuJoCo"] + [(SINGLE, "warp")]
    starts = f"{len(one['success'])} paired starts ({', '.join(TOOLS)})"
    lines = ["# MuJoCo beside mujoco-warp", "", "Written by `benchmarks/bench_engines_paired.py`. The shipped teacher from",
             f"{starts}, strict physics, {AT_ONCE} worlds at once, warp on {device}.", "",
             "| figure | first | rate | second | rate | second - first | only first | only second | McNemar, exact p |",
             "|---|---|---|---|---|---|--:|--:|--:|"]  # fmt: skip
    lines += [row(figure, names, *(found[name][figure] > 0 for name in names)) for names in pairs for figure in FIGURES]
    differ = [" and ".join(names) for names in pairs if not zero_inside(*(found[name]["success"] for name in names))]
    diverged = ", ".join(f"{name} {int(run['diverged'])}" for name, run in found.items())
    spent = ", ".join(f"{name} {run['seconds']:.0f} s" for name, run in found.items())
    lines += ["", "Success of each tool:", "", f"| | {' | '.join(TOOLS)} |", f"|---{'|--:' * len(TOOLS)}|"]
    lines += [f"| {name} | {' | '.join(f'{(run[FIGURES[0]] > 0)[k :: len(TOOLS)].mean():.3f}' for k in range(len(TOOLS)))} |"
              for name, run in found.items()]  # fmt: skip
    return [*lines, "", "`one contact`: pairs of convex shapes touch in one point at most (`mjDSBL_MULTICCD`).", "",
            "Rates have Wilson's intervals, differences the bootstrap's over pairs (95 %). The interval of the",
            f"difference of Succ does not contain 0 for: {', '.join(differ) or 'none'}. Diverged worlds: {diverged}.",
            f"Wall time, side by side, kernels included: {spent}.", ""]  # fmt: skip


def row(figure: str, names: tuple[str, str], one: np.ndarray, two: np.ndarray) -> str:
    """Row of one figure, (n,) bool in both runs."""
    low, high = difference(one, two)
    first, second = int((one & ~two).sum()), int((two & ~one).sum())
    p = binomtest(first, first + second).pvalue if first + second else 1.0
    between = f"{two.mean() - one.mean():+.3f} [{low:+.3f}, {high:+.3f}]"
    return f"| {figure} | {names[0]} | {rate(one)} | {names[1]} | {rate(two)} | {between} | {first} | {second} | {p:.2f} |"


def rate(found: np.ndarray) -> str:
    """Rate with its interval."""
    low, high = wilson_interval(int(found.sum()), len(found))
    return f"{found.mean():.3f} [{low:.3f}, {high:.3f}]"


def difference(one: np.ndarray, two: np.ndarray) -> tuple[float, float]:
    """Interval of the mean difference over pairs."""
    low, high = bootstrap_interval((two.astype(float) - one.astype(float))[:, None], RESAMPLES, SEED)[:, 0]
    return float(low), float(high)


def zero_inside(one: np.ndarray, two: np.ndarray) -> bool:
    """True where the interval of the difference contains 0."""
    low, high = difference(one > 0, two > 0)
    return low <= 0 <= high


if __name__ == "__main__":
    main()
