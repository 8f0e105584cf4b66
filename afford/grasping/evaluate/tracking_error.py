"""How near hands come to clips of people: the prior, whoever copies the clip itself, and nobody.

The prior is not told of the clip: it begins as the clip begins, over the same object, and does what people do. So what it is off
by is how much one person differs from another, too. Motors that go where the clip goes are as near as physics allows; a hand that
stays where it began is as far as one may expect of nobody.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from afford.grasping.env.rollout import BaseOnly
from afford.grasping.env.task import make_task
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from afford.grasping.policies.load_policy import Policy, load_policy
from afford.grasping.sim.scene import Physics
from schemas.episodes import ClipsFollowed
from schemas.files import FileTree
from schemas.grasp import GraspObject
from schemas.hand import HandModel, HandReference

FOLLOWERS = ("prior", "clip", "still")
FIGURES = ("level_1_m", "level_2_m", "tips_error_m", "followed")
Follower = Callable[[GraspImitationWorlds], np.ndarray]


@dataclass(frozen=True)
class TrackingParams:
    """Params of stages/grasping/imitation_evaluate.py say what each field means."""

    engine: str
    level: str
    iterations: int
    rate_hz: int
    tolerance_m: float
    at_once: int
    seed: int


def evaluate_tracking(hand: HandModel, bodies: Sequence[GraspObject], references: Sequence[HandReference], files: FileTree,
                      asked: TrackingParams, progress: Callable[[int, int], None]) -> ClipsFollowed:  # fmt: skip
    """Every clip once by each of FOLLOWERS, from where the clip begins. ValueError for files that are no prior, no clips, or a clip
    whose object is not among the bodies.
    """
    policy, of = load_policy(files, {}), {one.name: make_task(one) for one in bodies}
    _check(policy, set(of), references)
    config = GraspImitationConfig(engine=asked.engine, physics=Physics(asked.rate_hz, asked.iterations),
                                  steps=int(policy.facts["steps"]),
                       lift_m=float(policy.facts["lift_m"]), tolerance_m=asked.tolerance_m)  # fmt: skip
    parts = list[np.ndarray]()
    for first in range(0, len(references), asked.at_once):
        some = references[first : first + asked.at_once]
        core = GraspImitationWorlds(hand, [of[one.object_name] for one in some], some, config, alone=True)
        parts.append(np.stack([_follow(core, _actor(name, policy, core), asked.seed) for name in FOLLOWERS]))
        core.close()
        progress(first + len(some), len(references))
    level_1, level_2, tips, kept = np.concatenate(parts, axis=1).reshape(-1, len(FIGURES)).T.copy()
    clips = tuple(one.name for one in references)
    return ClipsFollowed(
        name=f"prior-{asked.level}-{asked.engine}", level=asked.level, engine=asked.engine,
        follower=tuple(np.repeat(FOLLOWERS, len(clips)).tolist()), clip=clips * len(FOLLOWERS),
        level_1_m=level_1, level_2_m=level_2, tips_m=tips, followed=kept > 0)  # fmt: skip


def _check(policy: Policy, known: set[str], references: Sequence[HandReference]) -> None:
    unknown = sorted({one.object_name for one in references} - known)
    wrong = "another policy" if policy.prior is None or policy.teacher is not None else "no clip" if not references else ""
    if wrong or unknown:
        raise ValueError(f"imitation_evaluate: expected a prior, and one clip or more of objects among {', '.join(sorted(known))}, "
                         f"got {wrong or ', '.join(unknown)}; give it what hand_imitation made, and clips of those objects")


def _actor(name: str, policy: Policy, core: GraspImitationWorlds) -> Follower:
    if name == "clip":
        return GraspImitationWorlds.expert
    actor = policy.actor(core.grasping) if name == "prior" else BaseOnly()
    return lambda now: actor.act(now.grasping)


def _follow(core: GraspImitationWorlds, act: Follower, seed: int) -> np.ndarray:
    """(n, FIGURES) of an episode of every world, all of it, whether it failed or not."""
    n = len(core.clips.references)
    rngs = [np.random.default_rng([seed, k]) for k in range(n)]
    core.reset(range(n), rngs)
    kept = np.ones(n, bool)
    for _ in range(core.config.steps):
        kept &= ~core.step(act(core), rngs).terminated
    report = core.report()
    return np.stack([*(report[name] for name in FIGURES[:3]), kept], axis=1)
