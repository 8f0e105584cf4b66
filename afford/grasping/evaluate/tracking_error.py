"""Tracking error on held-out human clips: of the imitation prior and of two baselines.

The prior does not receive the clip. It starts as the clip starts, over the same object, so its error includes the variation
between people. The baseline `clip` commands the joints of the clip, which is as near as physics allows. The baseline `still` stays
at the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from afford.grasping.env.rollout import BaseOnly
from afford.grasping.env.task import make_task
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from afford.grasping.policies.load_policy import Policy, load_policy
from afford.grasping.sim.engine import check_stage_engine
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
    """Parameters, as in stages/grasping/imitation_evaluate.py."""

    engine: str
    level: str
    iterations: int
    rate_hz: int
    tolerance_m: float
    at_once: int
    seed: int

    def __post_init__(self) -> None:
        check_stage_engine(self.engine)


def evaluate_tracking(hand: HandModel, bodies: Sequence[GraspObject], references: Sequence[HandReference], files: FileTree,
                      params: TrackingParams, progress: Callable[[int, int], None]) -> ClipsFollowed:  # fmt: skip
    """Run every clip once with each of FOLLOWERS, from the start of the clip.

    ValueError for files that contain no prior, for no clips, or for a clip whose object is not among the bodies.
    """
    policy, of = load_policy(files, {}), {one.name: make_task(one) for one in bodies}
    _check(policy, set(of), references)
    config = GraspImitationConfig(
        engine=params.engine, physics=Physics(params.rate_hz, params.iterations), steps=int(policy.facts["steps"]),
        lift_m=float(policy.facts["lift_m"]), tolerance_m=params.tolerance_m)  # fmt: skip
    parts = list[np.ndarray]()
    for first in range(0, len(references), params.at_once):
        some = references[first : first + params.at_once]
        core = GraspImitationWorlds(hand, [of[one.object_name] for one in some], some, config, alone=True)
        parts.append(np.stack([_follow(core, _actor(name, policy, core), params.seed) for name in FOLLOWERS]))
        core.close()
        progress(first + len(some), len(references))
    level_1, level_2, tips, kept = np.concatenate(parts, axis=1).reshape(-1, len(FIGURES)).T.copy()
    clips = tuple(one.name for one in references)
    return ClipsFollowed(
        name=f"prior-{params.level}-{params.engine}", level=params.level, engine=params.engine,
        follower=tuple(np.repeat(FOLLOWERS, len(clips)).tolist()), clip=clips * len(FOLLOWERS),
        level_1_m=level_1, level_2_m=level_2, tips_m=tips, followed=kept > 0)  # fmt: skip


def _check(policy: Policy, known: set[str], references: Sequence[HandReference]) -> None:
    unknown = sorted({one.object_name for one in references} - known)
    wrong = "another policy" if policy.prior is None or policy.teacher is not None else "no clip" if not references else ""
    if wrong or unknown:
        raise ValueError(f"imitation_evaluate: expected a prior, and one clip or more of objects among {', '.join(sorted(known))}, "
                         f"got {wrong or ', '.join(unknown)}; use the output of hand_imitation, and clips of those objects")


def _actor(name: str, policy: Policy, core: GraspImitationWorlds) -> Follower:
    if name == "clip":
        return GraspImitationWorlds.expert
    actor = policy.actor(core.grasping) if name == "prior" else BaseOnly()
    return lambda now: actor.act(now.grasping)


def _follow(core: GraspImitationWorlds, act: Follower, seed: int) -> np.ndarray:
    """Return (n, FIGURES) of a full episode in every world, also after a failure."""
    n = len(core.clips.references)
    rngs = [np.random.default_rng([seed, k]) for k in range(n)]
    core.reset(range(n), rngs)
    kept = np.ones(n, bool)
    for _ in range(core.config.steps):
        kept &= ~core.step(act(core), rngs).terminated
    report = core.report()
    return np.stack([*(report[name] for name in FIGURES[:3]), kept], axis=1)
