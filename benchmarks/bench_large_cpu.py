"""Measure a 7B two-hand model with SAM ViT-H on a CPU: minutes and memory of one answer; writes benchmarks/large_cpu.md.

    PYTHONPATH=. python benchmarks/bench_large_cpu.py [--scratch DIR] [--size 7b] [--kept]

Writes 15 GB of random weights in bfloat16 into DIR (`--kept` leaves them there for another run), then runs `predict`. Anonymous
memory leaves out the pages of files, which the system drops when it needs room.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import torch
from safetensors.torch import save_file

from afford.models.importing.source import INDEX
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.model_folder import config_json
from benchmarks.bench_weights_import import anonymous_mib
from benchmarks.pages import ROOT
from tests.helpers.large_models import write_backbones

PAGE = ROOT / "benchmarks" / "large_cpu.md"
TENSORS = 100
"""tensors of a shard"""


def written(folder: Path, size: str) -> Path:
    """Write a model of published size with random weights in bfloat16, in shards, as `weights import` writes it."""
    if (folder / INDEX).is_file():
        return folder
    config = ModelConfig(variant="vlm", size_px=(1024, 1024), hypotheses=1, backbones=str(write_backbones(folder / "sizes", size)))
    with torch.device("meta"):
        model = build(config, 0, pretrained=False)
    for name, text in {**model.extra_files(), "config.json": config_json(config)}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    shapes, weight_map = {name: tensor.shape for name, tensor in model.state_dict().items()}, {}
    rng, names = np.random.default_rng(0), list(shapes)
    for n in range(0, len(names), TENSORS):
        file = f"model-{n:05d}.safetensors"
        save_file({name: drawn(rng, shapes[name]) for name in names[n : n + TENSORS]}, folder / file)
        weight_map |= dict.fromkeys(names[n : n + TENSORS], file)
    (folder / INDEX).write_text(json.dumps({"weight_map": weight_map}))
    return folder


def drawn(rng: np.random.Generator, shape: torch.Size) -> torch.Tensor:
    """Random weights of a layer, in bfloat16."""
    flat = torch.from_numpy(rng.random(shape.numel(), np.float32)).mul_(2).sub_(1).mul_(0.03)
    return flat.reshape(shape).to(torch.bfloat16)


def peaks(command: list[str]) -> tuple[float, float, float]:
    """Seconds of a command, its largest anonymous memory, and its largest memory with mapped pages of files, in GiB."""
    began, anonymous = time.perf_counter(), 0.0
    process = subprocess.Popen(command)
    while True:
        done, status, usage = os.wait4(process.pid, os.WNOHANG)
        if done:
            break
        anonymous = max(anonymous, anonymous_mib(process.pid))
        time.sleep(0.1)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"{' '.join(command)}: exit code {os.waitstatus_to_exitcode(status)}")
    return time.perf_counter() - began, anonymous / 1024, usage.ru_maxrss / (1 << 20)


def main() -> None:
    """Write the model, answer one picture, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scratch", type=Path, default=ROOT.parent / "large")
    parser.add_argument("--size", default="7b", choices=("7b", "13b"))
    parser.add_argument("--kept", action="store_true")
    args = parser.parse_args()
    args.scratch.mkdir(parents=True, exist_ok=True)
    folder = written(args.scratch / args.size, args.size)
    picture = args.scratch / "picture.png"
    cv2.imwrite(str(picture), np.random.default_rng(0).integers(0, 255, (256, 456, 3)).astype(np.uint8))
    command = [sys.executable, str(ROOT / "pipeline.py"), "predict", str(picture), "pour tea", "--model", str(folder), "--out",
               str(args.scratch / "found"), "--force", "--hands", "both"]  # fmt: skip
    seconds, anonymous, resident = peaks(command)
    answer = json.loads((args.scratch / "found" / "predictions.json").read_text())["predictions"][0].get("answer", "")
    size = sum(path.stat().st_size for path in folder.glob("*.safetensors")) / 1e9
    text = (f"Written by `benchmarks/bench_large_cpu.py` on {os.cpu_count()} cores: {args.size.upper()} with SAM ViT-H, random "
            f"weights in bfloat16, one picture with a generated answer of {len(answer)} characters.")  # fmt: skip
    PAGE.write_text("\n".join((
        "# A large two-hand model on a CPU", "", text, "", "| model | files | minutes | anonymous memory | with mapped pages |",
        "|---|--:|--:|--:|--:|",
        f"| {args.size.upper()} | {size:.1f} GB | {seconds / 60:.1f} | {anonymous:.1f} GiB | {resident:.1f} GiB |", "")))
    if not args.kept:
        shutil.rmtree(args.scratch)


if __name__ == "__main__":
    main()
