"""Clips that are no example are dropped: a hand that does nothing but follow them must lift the object and hold it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.grasping.env.task import Task
from afford.grasping.imitation.rehearse import Rehearsal, Rehearsing
from schemas.hand import HandModel, HandReference


def held(hand: HandModel, tasks: Sequence[Task], references: Sequence[HandReference], config: Rehearsal, times: int, worlds: int,
         seed: int) -> np.ndarray:  # fmt: skip
    """(k,) how often of `times` each reference, followed by itself, ends with its object held; `worlds` of them at once.
    ValueError for a reference whose object is not among the tasks.
    """
    of = {one.body.name: one for one in tasks}
    if unknown := sorted({one.object_name for one in references} - set(of)):
        raise ValueError(f"references: expected objects among {', '.join(sorted(of))}, got {', '.join(unknown)}")
    parts = [references[first : first + worlds] for first in range(0, len(references), worlds)]
    return np.concatenate([_held(hand, of, part, config, times, seed) for part in parts])


def _held(hand: HandModel, of: dict[str, Task], clips: Sequence[HandReference], config: Rehearsal, times: int,
          seed: int) -> np.ndarray:  # fmt: skip
    core = Rehearsing(hand, [of[clip.object_name] for clip in clips], clips, config, alone=True)
    out = np.zeros(len(clips))
    for number in range(times):
        rngs = [np.random.default_rng([seed, number, k]) for k in range(len(clips))]
        core.reset(range(len(clips)), rngs)
        for _ in range(config.steps):
            core.step(core.expert(), rngs)
        out += core.report()["held"]
    core.close()
    return out
