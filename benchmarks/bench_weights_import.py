"""Measure the memory and time of `weights import` on a random checkpoint of published size; writes benchmarks/weights_import.md.

    PYTHONPATH=. python benchmarks/bench_weights_import.py [--scratch DIR]

The checkpoint is SAM ViT-H in single precision, one file of 2.6 GB under the authors' names. Anonymous memory is that of the
command's process, without the pages of files, read twenty times a second.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from transformers import SamConfig, SamModel

from benchmarks.pages import ROOT
from tests.common.test_weights_import import published_sam

PAGE = ROOT / "benchmarks" / "weights_import.md"
VIT_H = {"hidden_size": 1280, "num_hidden_layers": 32, "num_attention_heads": 16, "global_attn_indexes": [7, 15, 23, 31]}


def anonymous_mib(process: int) -> float:
    """Anonymous memory of a process now."""
    return resident_mib(process, "RssAnon")


def resident_mib(process: int, kind: str) -> float:
    """Resident memory of a process now, of a kind in its status: anonymous, or of files (RssFile)."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{kind}:")), 0.0)


def measure(*arguments: str) -> tuple[float, float]:
    """Seconds and largest anonymous memory in MiB of a command of pipeline.py."""
    began, peak = time.perf_counter(), 0.0
    with subprocess.Popen([sys.executable, str(ROOT / "pipeline.py"), *arguments]) as process:
        while process.poll() is None:
            peak = max(peak, anonymous_mib(process.pid))
            time.sleep(0.05)
    if process.returncode:
        raise SystemExit(f"{' '.join(arguments)}: exit code {process.returncode}")
    return time.perf_counter() - began, peak


def main() -> None:
    """Make the checkpoint, import it in both types, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scratch", type=Path)
    with TemporaryDirectory(dir=parser.parse_args().scratch) as scratch:
        file = Path(scratch) / "sam_vit_h.pth"
        torch.save(published_sam(SamModel(SamConfig(vision_config=VIT_H))), file)
        lines = ["| type | file | seconds | anonymous memory | of the file |", "|---|--:|--:|--:|--:|"]
        for dtype in ("float32", "bfloat16"):
            seconds, peak = measure("weights", "import", "sam", str(file), "--out", f"{scratch}/{dtype}", "--dtype", dtype)
            size = file.stat().st_size / (1 << 20)
            lines.append(f"| {dtype} | {size:.0f} MiB | {seconds:.0f} | {peak:.0f} MiB | {peak / size:.2f} |")
    text = ("Written by `benchmarks/bench_weights_import.py`: SAM ViT-H, random, one file in single precision. The memory includes "
            "that of the libraries.")  # fmt: skip
    PAGE.write_text("\n".join(("# Memory of `weights import`", "", text, "", *lines, "")))


if __name__ == "__main__":
    main()
