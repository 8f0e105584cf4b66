"""`afford/HandImitation-v0`: a hand follows references, which are what people did (AffordDex, stage 1: HTI).

    import gymnasium
    env = gymnasium.make("afford/HandImitation-v0", hand=hand, body=body, references=references, reward="paper")

Action (24,) in -1..1 as in afford/AffordanceGrasp-v0, along the world's axes. Observation: see imitate.Imitating.observe. Reward:
the sum of `reward/...` in info, see imitation.py. Terminated when the hand is too far off, truncated at the end of the clip, which
is the success; the last info has `report`. All in tables: docs/grasping/grasp-environments.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium

from afford.grasping.env.single import Single
from afford.grasping.env.vector import Many
from afford.grasping.imitation.clips import ImitationConfig
from afford.grasping.imitation.imitate import Imitating
from schemas.grasp import GraspObject
from schemas.hand import HandModel, HandReference

ID = "afford/HandImitation-v0"


class HandImitation(Single):
    """One world. Keywords are the fields of clips.ImitationConfig."""

    def __init__(self, hand: HandModel, body: GraspObject, references: Sequence[HandReference], **config: Any) -> None:
        """ValueError without references, or for such of another hand; `body` lies aside."""
        self.core = Imitating(hand, body, references, 1, ImitationConfig(**config))
        super().__init__(self.core)


class HandImitationVector(Many):
    """n worlds. Keywords are the fields of clips.ImitationConfig."""

    def __init__(self, num_envs: int, hand: HandModel, body: GraspObject, references: Sequence[HandReference],
                 **config: Any) -> None:  # fmt: skip
        """As HandImitation."""
        self.core = Imitating(hand, body, references, num_envs, ImitationConfig(**config))
        super().__init__(self.core, num_envs)


if ID not in gymnasium.registry:  # it is there where afford is installed: afford/environments.py
    gymnasium.register(id=ID, entry_point="afford.grasping.imitation.imitate_env:HandImitation",
                       vector_entry_point="afford.grasping.imitation.imitate_env:HandImitationVector")  # fmt: skip
