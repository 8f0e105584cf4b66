"""Measure inference and training speed of SOR3D-AFF's model, compared with the paper's 22 ms. Writes benchmarks/sor3d_speed.md.

    PYTHONPATH=. python benchmarks/bench_sor3d_speed.py

CPU times are seconds of this process on one core; times of a CUDA device are synchronised wall seconds. The weights are random,
since speed does not depend on them. The flow input is computed beforehand (benchmarks/scene_flow.md); images need none.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch

from afford.rgbd.model.config import VARIANTS, Sor3dConfig
from afford.rgbd.model.losses import LossParams, losses
from afford.rgbd.model.model import Sor3d, build, predict_with_flip
from afford.rgbd.model.model_inputs import InputBatch
from afford.training.loop import autocast
from stages.rgbd import sor3d_train

PAGE = Path(__file__).with_name("sor3d_speed.md")
PUBLISHED_MS = 22
FRAMES, REPEATS = 10, {"small": 9, "paper": 3}
PLANS = {"small": sor3d_train.Params(), "paper": sor3d_train.PAPER}
HEAD = ("model", "device", "px", "million parameters", "picture, ms", f"video of {FRAMES} frames, ms", "the same, mirrored too, ms",
        "batch", "learns in", "learned, sequences / s", "peak of the device, GiB")  # fmt: skip


def median_s(work: Callable[[], object], device: str, repeats: int) -> float:
    """Return the median seconds of a call, after one warm-up call."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    work()
    found = []
    for _ in range(repeats):
        _wait(device)
        start = clock()
        work()
        _wait(device)
        found.append(clock() - start)
    return statistics.median(found)


def _wait(device: str) -> None:
    if device == "cuda":
        torch.cuda.synchronize()


def seen(count: int, length: int, config: Sor3dConfig, device: str) -> InputBatch:
    """Build `count` sequences of noise."""
    shape = (count, length, 4, config.size_px, config.size_px)
    return InputBatch(torch.rand(shape, device=device), torch.rand((count, length, 3, *shape[3:]), device=device))


def answers_ms(model: Sor3d, device: str, repeats: int) -> list[float]:
    """Measure an image, a video, and a video with its mirror image, in ms."""
    ways = ((model, 1), (model, FRAMES), (lambda frames: predict_with_flip(model, frames), FRAMES))
    with torch.inference_mode():
        return [1000 * median_s(lambda: ask(frames), device, repeats)  # noqa: B023  # called before the next
                for ask, frames in ((ask, seen(1, length, model.config, device)) for ask, length in ways)]  # fmt: skip


def learned_per_s(model: Sor3d, name: str, device: str) -> float:
    """Measure forward, losses, backward and AdamW, in the batches of a training plan."""
    plan, size = PLANS[name], model.config.size_px
    optimiser = torch.optim.AdamW(model.train().parameters(), lr=plan.lr)
    frames = seen(plan.batch, FRAMES, model.config, device)
    label, action = (torch.zeros(shape, dtype=torch.long, device=device) for shape in ((plan.batch, size, size), (plan.batch,)))

    def step() -> None:
        with autocast(device, plan.bf16):
            found = losses(model(frames), label, action, LossParams(dice=plan.dice_weight), 0.0)
        found["total"].backward()
        optimiser.step()
        optimiser.zero_grad()

    return plan.batch / median_s(step, device, 1 if (name, device) == ("paper", "cpu") else REPEATS[name])


def row(name: str, device: str) -> list[str]:
    """One model on one device."""
    config = VARIANTS[name]() if name == "paper" else Sor3dConfig(size_px=PLANS[name].height_px)
    model = build(config, 0).to(device).eval()
    count = sum(parameter.numel() for parameter in model.parameters())
    times = [f"{ms:.1f}" for ms in answers_ms(model, device, REPEATS[name])]
    rate = f"{learned_per_s(model, name, device):.2g}"
    peak = f"{torch.cuda.max_memory_allocated() / 2**30:.1f}" if device == "cuda" else ""
    learns = [str(PLANS[name].batch), precision(name, device), rate]
    return [name, device, str(config.size_px), f"{count / 1e6:.2f}", *times, *learns, peak]


def precision(name: str, device: str) -> str:
    """Return the training precision of a plan on a device of this machine."""
    with autocast(device, PLANS[name].bf16):
        return str((torch.ones(2, 2, device=device) @ torch.ones(2, 2, device=device)).dtype).removeprefix("torch.")


def main() -> None:
    """Measure, then write."""
    torch.set_num_threads(1)
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    rows = [row(name, device) for device in devices for name in VARIANTS]
    table = ["| " + " | ".join(cells) + " |" for cells in (HEAD, ["---"] * 2 + ["--:"] * (len(HEAD) - 2), *rows)]
    note = "" if len(devices) > 1 else " No CUDA device was at hand."
    PAGE.write_text("\n".join([
        "# Speed of SOR3D-AFF's model", "", "Random weights. Answers are in float32. CPU: CPU time on one core; cuda: the clock. "
        "Learning: forward, losses, backward and AdamW. Written by `benchmarks/bench_sor3d_speed.py`.", "", *table, "",
        f"Published: {PUBLISHED_MS} ms a mask.{note}"]) + "\n")
    print(PAGE.read_text())


if __name__ == "__main__":
    main()
