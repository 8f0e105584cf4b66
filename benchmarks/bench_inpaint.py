"""Measure time per frame and memory of the learned inpainters at their published sizes. Writes benchmarks/inpaint.md.

    PYTHONPATH=. python benchmarks/bench_inpaint.py [--device cuda] [--dtype bfloat16] [--batch 8] [--threads 1]

Weights are random, since cost does not depend on them. One window of VIDM is four frames at 256 x 256, one of which is filled;
its sampler runs a few steps, and the time of the published 200 is extrapolated. LaMa fills one frame of 456 x 256. Each model
runs in a process of its own, so that its memory is measured separately. Rows of other devices and types stay in the page.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import nn

from afford.extraction.inpaint.lama import fill as fill_lama
from afford.extraction.inpaint.lama_network import Generator, LamaConfig
from afford.extraction.inpaint.vidm_model import Vidm
from afford.extraction.inpaint.vidm_model import fill as fill_vidm
from afford.extraction.inpaint.vidm_unet import VidmConfig
from afford.models.loading import device_of, dtype_of

PAGE = Path(__file__).with_name("inpaint.md")
ROOT = PAGE.parent.parent
PUBLISHED_STEPS, STEPS = 200, (1, 3)
GIB = 2**30
HEAD = ("model", "device", "type", "batch", "million parameters", "ms a frame", "of which one step", "GiB")


def timed_s(work: Callable[[], object], device: torch.device) -> float:
    """Wall seconds on a GPU, CPU seconds of this process on a CPU, whose neighbours slow it."""
    clock = time.perf_counter if device.type == "cuda" else time.process_time
    _wait(device)
    start = clock()
    work()
    _wait(device)
    return clock() - start


def vidm(device: torch.device, dtype: torch.dtype, batch: int) -> tuple[nn.Module, float, float]:
    """The model, seconds for a frame with the published steps, seconds for one step of one frame."""
    model = _random(Vidm, VidmConfig(), device)
    model.unet.to(dtype)
    rng = np.random.default_rng(0)
    rgb, holes = rng.integers(0, 256, (batch, 4, 256, 256, 3), np.uint8), np.zeros((batch, 4, 256, 256), bool)
    holes[:, :, 90:180, 80:170] = True

    def run(steps: int) -> Callable[[], object]:
        return lambda: fill_vidm(model, rgb, holes, steps=steps, eta=1.0, seeds=range(batch))

    few, more = (timed_s(run(steps), device) for steps in STEPS)
    if device.type == "cuda":  # the first calls chose their kernels
        few, more = (timed_s(run(steps), device) for steps in STEPS)
    step = (more - few) / (STEPS[1] - STEPS[0])
    return model, (few + step * (PUBLISHED_STEPS - STEPS[0])) / batch, step / batch


def lama(device: torch.device, dtype: torch.dtype, batch: int) -> tuple[nn.Module, float, float]:
    """The model, and twice the seconds for a frame: it has one step."""
    model = _random(Generator, LamaConfig(), device).to(dtype)
    rgb, holes = np.zeros((batch, 256, 456, 3), np.uint8), np.zeros((batch, 256, 456), bool)
    holes[:, 90:180, 80:170] = True
    timed_s(lambda: fill_lama(model, rgb, holes), device)
    found = timed_s(lambda: fill_lama(model, rgb, holes), device) / batch
    return model, found, found


MODELS = {"vidm": vidm, "lama": lama}


def measure(name: str, args: argparse.Namespace) -> list[str]:
    """One row of the table."""
    torch.set_num_threads(args.threads)
    device = device_of(args.device)
    model, frame_s, step_s = MODELS[name](device, dtype_of(args.dtype), args.batch)
    count = sum(parameter.numel() for parameter in model.parameters())
    if device.type == "cuda":
        where, used = torch.cuda.get_device_name(device), torch.cuda.max_memory_allocated(device) / GIB
    else:
        where = f"{args.threads} core, {platform.machine()}"
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIB
    times = (f"{1000 * frame_s:,.0f}", f"{1000 * step_s:,.0f}")
    return [name, where, args.dtype, str(args.batch), f"{count / 1e6:.1f}", *times, f"{used:.1f}"]


def table(rows: list[list[str]]) -> str:
    """The page, with the rows that it already has of other devices, types and batches."""
    old = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in PAGE.read_text().splitlines()
           if line.startswith(("| vidm", "| lama"))] if PAGE.exists() else []  # fmt: skip
    kept = {tuple(row[:4]): row for row in [*old, *rows]}
    lines = ["| " + " | ".join(row) + " |" for row in (HEAD, ["---"] * 3 + ["--:"] * 5, *(kept[key] for key in sorted(kept)))]
    head = (f"Published sizes, random weights. VIDM: a frame of 256 x 256 from four, {PUBLISHED_STEPS} steps, "
            f"extrapolated from {STEPS[1]};"
            " LaMa: one of 456 x 256, one step. On a CPU CPU time and the largest memory of the process; on a GPU wall time "
            "and the largest memory allocated. Written by `benchmarks/bench_inpaint.py`.")  # fmt: skip
    return "\n".join(["# Cost of the learned inpainters", "", head, "", *lines]) + "\n"


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--dtype", default="float32")
    parser.add_argument("--batch", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--only", choices=MODELS, help="measure one model in this process and print its row as JSON")
    args = parser.parse_args()
    if args.only:
        print(json.dumps(measure(args.only, args)))
        return
    same = [word for name in ("device", "dtype", "batch", "threads") for word in (f"--{name}", str(getattr(args, name)))]
    rows = []
    for name in MODELS:
        command = [sys.executable, __file__, "--only", name, *same]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    PAGE.write_text(table(rows))
    print(PAGE.read_text())


def _random(kind: type, config: object, device: torch.device) -> nn.Module:
    with torch.device("meta"):
        model = kind(config)
    model.to_empty(device=device)
    with torch.no_grad():
        for tensor in (*model.parameters(), *model.buffers()):
            if tensor.is_floating_point():
                tensor.normal_(0, 0.02)
    for name, tensor in model.named_buffers():
        if name.endswith("running_var"):
            tensor.fill_(1)
    return model.eval()


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


if __name__ == "__main__":
    main()
