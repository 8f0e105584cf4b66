"""Episodes on household bodies -> those of each grasp family with a recording, a few each, for films and sheets by family.

Reads   BodyTasks of household_tasks; GraspEpisodes of one policy in one engine
Writes  GraspEpisodes of each family that has a trace, with the traces that are shown
Method  the first traces, of as many categories as there are
Fails   never
Paper   none
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes

LIBRARIES = ("numpy", "scipy", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of household_shown."""

    shown: int = 6
    """episodes of a family, at most"""


def run(bodies: tuple[BodyTasks, ...], episodes: GraspEpisodes, params: Params) -> tuple[GraspEpisodes, ...]:
    """Select the episodes."""
    from afford.grasping.evaluate.household_report import by_family

    return by_family(bodies, episodes, params.shown)
