"""Compare success of the shipped teacher in MuJoCo and in mujoco-warp from the same starts; writes benchmarks/engines_paired.md.

    PYTHONPATH=. python benchmarks/bench_engines_paired.py [--starts 256] [--device cpu] [--processes 1]

A start is an object, its place and yaw, and the place of the hand, all drawn from the seed; both engines get the same. Physics are
those of evaluations (100 iterations, 480 Hz). A second run of MuJoCo, with fewer worlds at once, says what a batch size alone
changes: the policy's floats are rounded otherwise. Needs the extra `gpu`; on a CPU the first run compiles kernels for minutes.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

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
from afford.grasping.sim.scene import STRICT
from benchmarks.bench_grasp_env import tool
from benchmarks.pages import ROOT
from schemas.mesh import ObjectSpec
from stages.grasping import grasp_tasks

PAGE = ROOT / "benchmarks" / "engines_paired.md"
TOOLS = ("screwdriver", "knife", "spatula", "chisel")
"""categories of the procedural tools"""
AT_ONCE, FEWER, SEED, RESAMPLES = 64, 16, 20271, 10_000
FIGURES = ("success", "held")


def main() -> None:
    """Play all starts in both engines, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=256)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--processes", type=int, default=1, help="runs side by side")
    args = parser.parse_args()
    tasks = [grasp_task(category) for category in TOOLS]
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        runs = {name: pool.submit(play, engine, tasks, args.starts, device, at_once) for name, (engine, device, at_once) in
                {"warp": ("warp", args.device, AT_ONCE), "MuJoCo": ("mujoco", "cpu", AT_ONCE),
                 f"MuJoCo, {FEWER} at once": ("mujoco", "cpu", FEWER)}.items()}  # fmt: skip
        found = {name: run.result() for name, run in runs.items()}
    PAGE.write_text("\n".join(page(found, args.device)))


def grasp_task(category: str) -> Task:
    """Task of a tool by its handle, with N_t of its other parts."""
    spec = ObjectSpec(f"{category}_11", category, 11, "plain", "train")
    return from_grasp_task(grasp_tasks.run(spec, tool(category).body, grasp_tasks.Params(within_m=1.0))[0])


def play(engine: str, tasks: list[Task], starts: int, device: str, at_once: int) -> dict[str, np.ndarray]:
    """Play the shipped teacher: its figures (n,) by name, and the numbers `diverged` and `seconds`."""
    policy = load_policy(tree("teacher", ROOT / "weights" / "grasp-teacher"), {})
    config = replace(policy.config(engine, STRICT, "flat", 0.0), device=device)
    out, began = list[dict[str, np.ndarray]](), time.perf_counter()
    with TemporaryDirectory() as scratch:
        recorder = FlightRecorder(Path(scratch), engine, SEED)
        worlds = GraspWorlds(default.hand(), [tasks[k % len(tasks)] for k in range(at_once)], config, recorder)
        for first in range(0, starts, at_once):
            rngs = [np.random.default_rng([SEED, *divmod(k, AT_ONCE)]) for k in range(first, first + at_once)]
            out.append(rollout(worlds, policy.actor(worlds), rngs).report)
            means = {name: out[-1][name].mean() for name in FIGURES}
            print(engine, at_once, first, means, round(time.perf_counter() - began), flush=True)
        worlds.close()
    spent = {"diverged": np.array(recorder.count), "seconds": np.array(time.perf_counter() - began)}
    return {name: np.concatenate([row[name] for row in out]) for name in out[0]} | spent


def page(found: dict[str, dict[str, np.ndarray]], device: str) -> list[str]:
    """Lines of the page."""
    one = found["MuJoCo"]
    others = {name: run for name, run in found.items() if name != "MuJoCo"}
    starts = f"{len(one['success'])} paired starts ({', '.join(TOOLS)})"
    lines = ["# MuJoCo beside mujoco-warp", "", "Written by `benchmarks/bench_engines_paired.py`. The shipped teacher from",
             f"{starts}, strict physics, {AT_ONCE} worlds at once, warp on {device}.", "",
             "| figure | MuJoCo | beside | rate | beside - MuJoCo | only MuJoCo | only beside | McNemar, exact p |",
             "|---|---|---|---|---|--:|--:|--:|"]  # fmt: skip
    lines += [row(figure, name, one[figure] > 0, two[figure] > 0) for name, two in others.items() for figure in FIGURES]
    differ = [name for name, two in others.items() if not zero_inside(one["success"], two["success"])]
    diverged = ", ".join(f"{name} {int(run['diverged'])}" for name, run in found.items())
    spent = ", ".join(f"{name} {run['seconds']:.0f} s" for name, run in found.items())
    return [*lines, "", "Rates have Wilson's intervals, differences the bootstrap's over pairs (95 %). The interval of the",
            f"difference of Succ does not contain 0 for: {', '.join(differ) or 'none'}. Diverged worlds: {diverged}.",
            f"Wall time, side by side, kernels included: {spent}.", ""]


def row(name: str, other: str, one: np.ndarray, two: np.ndarray) -> str:
    """Row of one figure, (n,) bool in both engines."""
    low, high = difference(one, two)
    first, second = int((one & ~two).sum()), int((two & ~one).sum())
    p = binomtest(first, first + second).pvalue if first + second else 1.0
    between = f"{two.mean() - one.mean():+.3f} [{low:+.3f}, {high:+.3f}]"
    return f"| {name} | {rate(one)} | {other} | {rate(two)} | {between} | {first} | {second} | {p:.2f} |"


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
