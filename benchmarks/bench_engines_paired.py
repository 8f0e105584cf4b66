"""Compare success of the shipped teacher in MuJoCo and in mujoco-warp from the same starts; writes benchmarks/engines_paired.md.

    PYTHONPATH=. python benchmarks/bench_engines_paired.py [--starts 256] [--device cpu]

A start is an object, its place and yaw, and the place of the hand, all drawn from the seed; both engines get the same. Physics are
those of evaluations (100 iterations, 480 Hz). Needs the extra `gpu`; on a CPU the first run compiles kernels for minutes.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
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
AT_ONCE, SEED, RESAMPLES = 64, 20271, 10_000
FIGURES = ("success", "held")


def main() -> None:
    """Play all starts in both engines, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=256)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    rounds = -(-args.starts // AT_ONCE)
    tasks = [grasp_task(category) for category in TOOLS]
    found = {engine: play(engine, tasks, rounds, device) for engine, device in (("mujoco", "cpu"), ("warp", args.device))}
    PAGE.write_text("\n".join(page(found, args.device)))


def grasp_task(category: str) -> Task:
    """Task of a tool by its handle, with N_t of its other parts."""
    spec = ObjectSpec(f"{category}_11", category, 11, "plain", "train")
    return from_grasp_task(grasp_tasks.run(spec, tool(category).body, grasp_tasks.Params(within_m=1.0))[0])


def play(engine: str, tasks: list[Task], rounds: int, device: str) -> dict[str, np.ndarray]:
    """Play the shipped teacher: its figures (n,) by name, and the numbers `diverged` and `seconds`."""
    policy = load_policy(tree("teacher", ROOT / "weights" / "grasp-teacher"), {})
    config = replace(policy.config(engine, STRICT, "flat", 0.0), device=device)
    out, began = list[dict[str, np.ndarray]](), time.perf_counter()
    with TemporaryDirectory() as scratch:
        recorder = FlightRecorder(Path(scratch), engine, SEED)
        worlds = GraspWorlds(default.hand(), [tasks[k % len(tasks)] for k in range(AT_ONCE)], config, recorder)
        for number in range(rounds):
            rngs = [np.random.default_rng([SEED, number, k]) for k in range(AT_ONCE)]
            out.append(rollout(worlds, policy.actor(worlds), rngs).report)
            print(engine, number, {name: out[-1][name].mean() for name in FIGURES}, round(time.perf_counter() - began), flush=True)
        worlds.close()
    spent = {"diverged": np.array(recorder.count), "seconds": np.array(time.perf_counter() - began)}
    return {name: np.concatenate([row[name] for row in out]) for name in out[0]} | spent


def page(found: dict[str, dict[str, np.ndarray]], device: str) -> list[str]:
    """Lines of the page."""
    one, two = found["mujoco"], found["warp"]
    count = len(one["success"])
    lines = ["# MuJoCo beside mujoco-warp", "", "Written by `benchmarks/bench_engines_paired.py`. The shipped teacher from",
             f"{count} paired starts ({', '.join(TOOLS)}), strict physics, {AT_ONCE} worlds at once, warp on {device}.", "",
             "| figure | MuJoCo | warp | warp - MuJoCo | only MuJoCo | only warp | McNemar, exact p |",
             "|---|---|---|---|--:|--:|--:|"]  # fmt: skip
    lines += [row(name, one[name] > 0, two[name] > 0) for name in FIGURES]
    differs = "contains 0" if zero_inside(one["success"], two["success"]) else "does not contain 0"
    return [*lines, "", "Rates have Wilson's intervals, differences the bootstrap's over pairs (95 %). The interval of the",
            f"difference of Succ {differs}. Diverged worlds: {int(one['diverged'])} in MuJoCo, {int(two['diverged'])} in warp.",
            f"Wall time: {one['seconds']:.0f} s and {two['seconds']:.0f} s, kernels included.", ""]


def row(name: str, one: np.ndarray, two: np.ndarray) -> str:
    """Row of one figure, (n,) bool in both engines."""
    low, high = difference(one, two)
    first, second = int((one & ~two).sum()), int((two & ~one).sum())
    p = binomtest(first, first + second).pvalue if first + second else 1.0
    between = f"{two.mean() - one.mean():+.3f} [{low:+.3f}, {high:+.3f}]"
    return f"| {name} | {rate(one)} | {rate(two)} | {between} | {first} | {second} | {p:.2f} |"


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
