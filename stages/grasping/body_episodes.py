"""evaluation episodes of several bodies -> one list of episodes, for a recording of all of them.

Reads   GraspEpisodes of one policy in one engine, one for each body
Writes  GraspEpisodes with the episodes and traces of all, in order
Method  concatenation
Fails   ValueError without episodes
Paper   none
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import GraspEpisodes

LIBRARIES = ("numpy", "scipy", "torch", "mujoco", "pybullet", "gymnasium", "trimesh", "safetensors")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_episodes."""

    policy: str = "teacher"
    """name of the policy in tables"""


def run(episodes: tuple[GraspEpisodes, ...], params: Params) -> GraspEpisodes:
    """Join the episodes of all bodies."""
    from afford.grasping.evaluate.evaluate_bodies import join_episodes

    return join_episodes(params.policy, episodes)
