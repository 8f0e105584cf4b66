"""Measure speed and contact depth of each engine in the grasp environment; writes a table of docs/grasping/physics.md.

    PYTHONPATH=. python benchmarks/bench_engines.py

The scripted grasp reaches, grasps and lifts. The definitions of all columns are above the table (DEFINITIONS). Rows of mujoco-warp
need the extra `gpu`, its GPU rows a GPU.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import torch

from afford.common.registry import extra
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.device_arrays import arrays_of
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.gym_env import PPOEnvAdapter
from afford.grasping.env.task import Task
from afford.grasping.hand.assets import shadow_files
from afford.grasping.policies.train_teacher import TeacherTrainingConfig, new_teacher
from afford.grasping.rl import ppo
from afford.grasping.sim.bullet_world import BulletWorld
from afford.grasping.sim.engine import CONTROL_S
from afford.grasping.sim.scene import Physics
from benchmarks.bench_grasp_env import TOOLS, tool
from benchmarks.pages import ROOT, into
from schemas.hand import HandModel
from stages.grasping import hand_model

PAGE = ROOT / "docs" / "grasping" / "physics.md"
STEPS, EPISODES = 40, 2
ON_CPU, ON_GPU = 16, 4096


@dataclass(frozen=True)
class Setting:
    """Row of the table."""

    engine: str
    iterations: int
    processes: int = 1
    worlds: int = ON_CPU
    device: str = "cpu"

    def config(self) -> GraspEnvConfig:
        """Return the configuration of the environment."""
        return GraspEnvConfig(engine=self.engine, physics=Physics(iterations=self.iterations), processes=self.processes,
                              device=self.device,
                      base="script", steps=STEPS)  # fmt: skip


SETTINGS = (*(Setting("bullet", iterations, processes) for iterations in (20, 50, 100) for processes in (1, 2)),
            Setting("mujoco", 50), Setting("mujoco", 100))  # fmt: skip
DEFINITIONS = """A physics step is one solver step of 1/240 s of one world. A control step is 1/20 s of one world: 12 physics steps,
observation and reward. Without learning, a script acts. With learning, PPO acts and updates small networks, whose time counts
too. CPU s are those of all processes; the column in wall seconds means nothing where other jobs run beside. In the solver: share
of the CPU time of control steps, without learning, that is inside the engine's own step (`stepSimulation`, `mj_step`,
mujoco-warp's `step`). At the goal: scripted grasps whose object is held at its goal at the end; compare speeds of rows where this
is alike.

"""
HEAD = [DEFINITIONS,
        "| engine | device | iterations | processes | worlds | at the goal | penetration median / p95 mm | in the solver "
        "| physics steps / CPU s | control steps / CPU s | control steps / s | learning, control steps / CPU s |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip


def main() -> None:
    """Measure, then write."""
    hand, tasks = hand_model.run(shadow_files(), hand_model.Params()), [tool(category) for category in TOOLS]
    rows = [row(hand, tasks, setting) for setting in (*SETTINGS, *_warp())]
    into(PAGE, "engines", Path(__file__).name, "\n".join([*HEAD, *rows, ""]))


def row(hand: HandModel, tasks: list[Task], setting: Setting) -> str:
    """Measure one setting."""
    core = GraspWorlds(hand, [tasks[k % len(tasks)] for k in range(setting.worlds)], setting.config())
    solver = SolverClock(core)
    cpu_s, clock_s, goal, depths = _rollouts(core, setting.worlds, solver)
    core.close()
    steps, physics = EPISODES * STEPS * setting.worlds, round(CONTROL_S * setting.config().physics.rate_hz)
    share = f"{100 * solver.spent_s / cpu_s:.0f} %" if setting.processes == 1 and setting.device == "cpu" else ""
    found = (f"| {setting.engine} | {setting.device} | {setting.iterations} | {setting.processes} | {setting.worlds} | "
             f"{100 * goal:.0f} % | {np.median(depths):.2f} / {np.percentile(depths, 95):.2f} | {share} "
             f"| {physics * steps / cpu_s:.0f} | {steps / cpu_s:.0f} | {steps / clock_s:.0f} "
             f"| {learning(hand, tasks, setting):.0f} |")  # fmt: skip
    print(found, flush=True)
    return found


class SolverClock:
    """CPU seconds inside the engine's own step, of worlds in this process."""

    def __init__(self, core: GraspWorlds) -> None:
        self.spent_s = 0.0
        for world in getattr(core.worlds, "worlds", ()):
            if isinstance(world, BulletWorld):
                world.client.stepSimulation = self._timed(world.client.stepSimulation)
            else:
                world._moved = self._timed(world._moved)
        for group in getattr(core.worlds, "_groups", ()):
            group._advance = self._timed(group._advance)

    def _timed(self, work: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            before = time.thread_time()
            found = work(*given, **named)
            self.spent_s += time.thread_time() - before
            return found

        return timed


def _rollouts(core: GraspWorlds, n: int, solver: SolverClock) -> tuple[float, float, float, np.ndarray]:
    """Return CPU seconds, seconds, share of objects at their goals at the end, and depths in mm, without the first step."""
    rngs = [np.random.default_rng(k) for k in range(n)]
    core.reset(range(n), rngs)
    core.step(np.zeros((n, core.motors)), rngs)
    cpu_s, clock_s, at_goal, depths = 0.0, 0.0, list[float](), list[np.ndarray]()
    solver.spent_s = 0.0
    for _ in range(EPISODES):
        core.reset(range(n), rngs)
        cpu, clock = _cpu_s(), time.perf_counter()
        for _ in range(STEPS):
            core.step(np.zeros((n, core.motors)), rngs)
            core.observe()
        cpu_s, clock_s = cpu_s + _cpu_s() - cpu, clock_s + time.perf_counter() - clock
        at_goal.append(float((core.report()["held"] == 1).mean()))
        depths.append(core.depths())
    found = 1000 * np.concatenate(depths).reshape(-1)
    return cpu_s, clock_s, float(np.mean(at_goal)), found[~np.isnan(found)]


def learning(hand: HandModel, tasks: list[Task], setting: Setting) -> float:
    """Return the control steps per CPU second of PPO with updates, without the first update; per second on a GPU."""
    arrays = arrays_of(setting.engine, setting.device)
    envs = AffordanceGraspVector(setting.worlds, hand, tasks, None, arrays, **vars(setting.config()))
    config, clock = ppo.PPOConfig(updates=2), list[float]()
    now = time.perf_counter if setting.device == "cuda" else _cpu_s
    model = new_teacher(TeacherTrainingConfig(0, setting.worlds, "small", 0.5, 0.5, config), envs.core.width, envs.core.motors)
    model.to(setting.device)
    torch.manual_seed(0)
    ppo.train(PPOEnvAdapter(envs, 0), model, config, ppo.make_optimizer(model, config.lr), 0,
              lambda *_: clock.append(now()))
    envs.close()
    return (config.updates - 1) * config.steps * setting.worlds / (clock[-1] - clock[0])


def _warp() -> list[Setting]:
    if not (importlib.util.find_spec("mujoco_warp") and importlib.util.find_spec("warp")):
        return []
    gpu = [Setting("warp", 50, 1, ON_GPU, "cuda")] if extra("warp", "gpu").is_cuda_available() else []
    return [Setting("warp", 50), *gpu]


def _cpu_s() -> float:
    """Return the CPU seconds of this process and of its children."""
    mine = psutil.Process()
    return float(sum(sum(one.cpu_times()[:2]) for one in (mine, *mine.children(recursive=True))))


if __name__ == "__main__":
    main()
