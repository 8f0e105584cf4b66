"""Tiny RGB-D sequences whose action can only be seen while they move: a square comes to rest where it was, or goes."""

from __future__ import annotations

import numpy as np

from afford.rgbd.model.model_inputs import ModelInput
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionClip, SceneFlow

SIZE, FRAMES = 32, 4
STILL = np.full(3, 128, np.uint8)


def seen(seed: int, frames: int = FRAMES, size: int = SIZE) -> ModelInput:
    """Noise of every kind."""
    rng = np.random.default_rng(seed)
    return ModelInput(rng.integers(0, 255, (frames, size, size, 3)).astype(np.uint8),
                rng.uniform(0.5, 1.0, (frames, size, size)).astype(np.float32),
                rng.integers(0, 255, (max(frames - 1, 0), size, size, 3)).astype(np.uint8), STILL)  # fmt: skip


def interaction(n: int, split: str) -> tuple[InteractionClip, SceneFlow]:
    """Sequence n: a bright square that is pushed (it slides) or lifted (it comes nearer and goes back); label on the square."""
    rng = np.random.default_rng([n, split == "val"])
    affordance = ("push", "lift")[n % 2]
    x, y = rng.integers(4, 16, 2)
    rgb = np.full((FRAMES, SIZE, SIZE, 3), 60, np.uint8) + rng.integers(0, 20, (FRAMES, SIZE, SIZE, 3)).astype(np.uint8)
    depth = np.full((FRAMES, SIZE, SIZE), 1.0, np.float32)
    flow = np.zeros((FRAMES - 1, SIZE, SIZE, 3), np.float32)
    label = np.full((SIZE, SIZE), BACKGROUND, np.uint8)
    for t in range(FRAMES):
        at = np.s_[t, y : y + 10, (left := x + (t if affordance == "push" else 0)) : left + 10]
        rgb[at] = 220
        depth[at] = 0.9 - 0.05 * (affordance == "lift") * (t in (1, 2))
        if t < FRAMES - 1:
            flow[at] = (0.01, 0, 0) if affordance == "push" else (0, 0, (-0.05, 0, 0.05)[t])
    label[y : y + 10, left : left + 10] = AFFORDANCES.index(affordance)
    name = f"{split}_{n:03d}"
    clip = InteractionClip(name, split, "can", affordance, rgb, depth, np.diag([40.0, 40, 1]), label, 10.0,
                           np.zeros((0, 3), np.float32))  # fmt: skip
    colour = (128 + 127 * np.clip(flow / 0.05, -1, 1)).round().astype(np.uint8)
    still = np.full((FRAMES - 1, SIZE, SIZE, 3), 128, np.uint8)
    return clip, SceneFlow(name, flow.astype(np.float16), np.zeros((*flow.shape[:3], 2), np.float16), colour, still,
                           np.full(6, 128, np.uint8))  # fmt: skip
