"""Choice of the place of each use of a body by trial: a policy plays the options in simulation, and the best one is kept.

The shape of a place hardly says whether a policy holds on there: at one place it always lifts a body, at one nearby never.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from afford.grasping.env.body_tasks import held_tasks
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.place_options import place_options
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.env.rest_choice import places_of
from afford.grasping.policies.grasp_trials import acting, trial_figures
from afford.grasping.policies.load_policy import Policy
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import Physics, Scene
from schemas.bodies import BodyTasks
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.surface import PartDescriptions


@dataclass(frozen=True)
class TrialSettings:
    """Settings of body_choose."""

    options: int
    turned: bool
    finalists: int
    episodes: int
    enough: float
    engines: tuple[str, ...]
    iterations: int
    rate_hz: int
    seed: int
    carry: bool


@dataclass(frozen=True)
class Choice:
    """Option that a policy did best of those that it played."""

    task: GraspTask
    number: int
    """0 for the place that the shape suggests"""
    score: float
    first: float
    """score at that place"""
    played: int


def choose_places(hand: HandModel, body: BodyTasks, described: PartDescriptions, policy: Policy, s: TrialSettings,
                  progress: Callable[[int, int], None]) -> BodyTasks:  # fmt: skip
    """Replace the place of each task of a body by the best one that the policy played; a note on each that is another one."""
    notes, chosen = {one.task: one for one in described.descriptions}, list[GraspTask]()
    remarks = list[str]()
    for number, task in enumerate(body.tasks):
        held = [one.hold for one in held_tasks(task, notes[task.use])] if task.use in notes else [task.hold]
        best = try_options(hand, place_options(task, held, s.options, s.turned), policy, s)
        chosen.append(best.task)
        remarks += [_remark(best)] if best.number else []
        progress(number + 1, len(body.tasks))
    return replace(body, tasks=tuple(chosen), family=tuple(places_of(one)[0].family for one in chosen),
                   notes=(*body.notes, *remarks))  # fmt: skip


def try_options(hand: HandModel, options: Sequence[GraspTask], policy: Policy, s: TrialSettings) -> Choice:
    """Play the options and choose the best: the first one in all engines, the others only if it is not good enough.

    They are played in the first engine, and the best of them in the other ones, `finalists` at most; of equal ones the first.
    """
    first = sum(_scores(hand, options[0], policy, s, s.engines)) / len(s.engines)
    best, score = 0, first
    others = range(1, len(options) if first < s.enough else 1)
    tried = {k: _scores(hand, options[k], policy, s, s.engines[:1])[0] for k in others}
    for k in sorted(others, key=lambda k: -tried[k])[: s.finalists]:
        if (tried[k] + len(s.engines) - 1) / len(s.engines) <= score or score >= s.enough:
            break
        found = (tried[k] + sum(_scores(hand, options[k], policy, s, s.engines[1:]))) / len(s.engines)
        best, score = (k, found) if found > score else (best, score)
    return Choice(options[best], best, score, first, 1 + len(others))


def _scores(hand: HandModel, task: GraspTask, policy: Policy, s: TrialSettings, engines: Sequence[str]) -> list[float]:
    """Score of a task in each engine: success and held, times the share of fingertips off N_t; 0 where the body does not rest."""
    out = list[float]()
    for engine in engines:
        config = policy.config(engine, Physics(iterations=s.iterations, rate_hz=s.rate_hz), "flat", 0.0)
        if not _rests(hand, task, config):
            out.append(0.0)
            continue
        worlds = PlacedWorlds(hand, [task] * s.episodes, config, s.carry)
        found = trial_figures([worlds], 1, acting(policy.actor), [s.seed])
        worlds.close()
        out.append(float((found["success"] + found["held"])[0] / 2 * (1 - found["as_violation_pct"][0] / 100)))
    return out


def _rests(hand: HandModel, task: GraspTask, config: GraspEnvConfig) -> bool:
    """Test whether the body of a task stays as it is laid."""
    scene = Scene(hand, task.body, config.physics)
    world = make_world(config.engine, scene)
    try:
        placed_rest_pose(world, scene)
    except ValueError:
        return False
    finally:
        world.close()
    return True


def _remark(best: Choice) -> str:
    return (f"{best.task.name}: at the {best.task.hold} ({places_of(best.task)[0].family}), the best of {best.played} places, with "
            f"a score of {best.score:.2f} in its trials against {best.first:.2f}")  # fmt: skip
