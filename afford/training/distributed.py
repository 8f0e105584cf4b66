"""Worker process of a distributed training: `python -m torch.distributed.run ... -m afford.training.distributed JOB.json SCRATCH`.

The main process prints its progress to stdout, a line `step steps` after each step.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from torch import distributed

from afford.training.job import read_job
from afford.training.loop import SINGLE_PROCESS, ProcessGroup, deterministic, fit


@contextmanager
def process_group(device: str) -> Iterator[ProcessGroup]:
    """Join the process group of `torch.distributed.run`; a single process when that launcher did not start this one."""
    if "WORLD_SIZE" not in os.environ:
        yield SINGLE_PROCESS
        return
    if device == "cuda":
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if device == "cuda" else "gloo")
    try:
        yield ProcessGroup(distributed.get_rank(), distributed.get_world_size())
    finally:
        distributed.destroy_process_group()


def main(job_file: Path, scratch: Path) -> None:
    """Train as one of the processes until the checkpoint in `scratch` is complete."""
    job = read_job(job_file.read_text())
    with deterministic(1, job.plan.device.partition(":")[0]), process_group(job.plan.device) as group:

        def progress(done: int, total: int) -> None:
            if group.is_main:
                sys.stdout.write(f"{done} {total}\n")
                sys.stdout.flush()

        fit(job, scratch, progress, group)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
