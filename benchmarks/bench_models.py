"""Measure inference and training speed of the two-hand models on one CPU core, and their size. Writes benchmarks/models.md.

Run with `PYTHONPATH=. python benchmarks/bench_models.py`. Times are CPU seconds of this process. The weights are random, since
speed does not depend on them.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch

from afford.twohands.model.interface import Batch, ModelConfig, Target, TwoHands, build
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.predictor import Predictor

GOAL_MS, GOAL_PER_S = 60, 60
REPEATS, BATCH = 9, 32
TASK = "pour tea from the kettle"
IMAGES = ((256, 456), (480, 854), (855, 855))
MODELS = {
    "small": ModelConfig(),
    "small, k = 1": ModelConfig(hypotheses=1),
    "clip from nothing, 128 x 128": ModelConfig(variant="clip", size_px=(128, 128), frozen=False),
}
PAGE = Path(__file__).with_name("models.md")


def cpu_s(work: Callable[[], object]) -> float:
    """Median CPU seconds of one call, after one that does not count."""
    work()
    found = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return statistics.median(found)


def predict_ms(model: TwoHands, height: int, width: int) -> float:
    """One image and task to a Prediction, letter-box and full-size maps included."""
    predictor, image = Predictor(model), np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    return 1000 * cpu_s(lambda: predictor.predict(image, TASK))


def trained_per_s(model: TwoHands) -> float:
    """Samples a second through forward, losses, backward and AdamW."""
    size = model.config.size_px
    batch = Batch(torch.rand(BATCH, 3, *size), (TASK,) * BATCH)
    masks = (torch.rand(BATCH, 2, *size) > 0.9).float()
    target = Target(masks, torch.ones(BATCH, 2, dtype=torch.bool), torch.full((BATCH,), 2))
    optimiser = torch.optim.AdamW(model.train().parameters())

    def step() -> None:
        losses(model(batch), target, LossParams())["total"].backward()
        optimiser.step()
        optimiser.zero_grad()

    return BATCH / cpu_s(step)


def row(name: str, config: ModelConfig) -> list[str]:
    """Name, size, times of one model."""
    model = build(config, 0)
    count = sum(parameter.numel() for parameter in model.parameters())
    times = [f"{predict_ms(model, *size):.1f}" for size in IMAGES]
    return [name, f"{count / 1e6:.2f}", *times, f"{trained_per_s(model):.0f}"]


def main() -> None:
    """Measure, then write."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    rows = [row(name, config) for name, config in MODELS.items()]
    head = ["model", "million parameters", *(f"predict {w} x {h}, ms" for h, w in IMAGES), "trained, samples / s"]
    table = ["| " + " | ".join(cells) + " |" for cells in (head, ["---", *["--:"] * (len(head) - 1)], *rows)]
    goals = (float(rows[0][2]) < GOAL_MS, float(rows[0][-1]) >= GOAL_PER_S)
    goals = [f"{goal}: {'met' if met else 'not met'}" for goal, met in zip(
        (f"under {GOAL_MS} ms an image at 456 x 256", f"at least {GOAL_PER_S} samples a second in training"), goals, strict=True)]
    text = "\n".join(["# Speed of the two-hand models", "", "CPU time on one core, random weights, float32; training in batches of "
                      f"{BATCH} with losses and AdamW. Written by `benchmarks/bench_models.py`.", "", *table, "",
                      f"Goals of `small`: {'; '.join(goals)}."]) + "\n"  # fmt: skip
    PAGE.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
