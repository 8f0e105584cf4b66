"""Train a job on a data set: the body of every stage that trains by the shared loop."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from afford.common import files
from afford.training import artifacts, curves, distributed, loop
from afford.training.job import Batch, Job, Progress
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Trained

DATA_FILES = ()  # ROOT is the working directory of the processes; no data is read from it
ROOT = Path(__file__).resolve().parent.parent.parent


def train_job(job: Job[Batch], dataset: FileTree, name: str, ctx: Context, threads: int, devices: int = 1) -> Trained:
    """Train on `devices` processes, each with a device of its own; a killed training resumes from the scratch folder.

    ValueError for several processes on one numbered GPU.
    """
    if devices > 1 and ":" in job.plan.device:
        raise ValueError(f"device: expected cpu or cuda for a training on {devices} devices, got {job.plan.device!r}, which is one "
                         "GPU; set device=cuda, and CUDA_VISIBLE_DEVICES to choose which")
    job.prepare({file.name: file.path for file in dataset.files}, ctx.scratch)
    if devices > 1:
        launch(job, ctx.scratch, devices, ctx.progress)
    with loop.deterministic(threads // job.plan.parallel, job.plan.device.partition(":")[0]):
        model, state = loop.fit(job, ctx.scratch, ctx.progress)
    log = curves.training_log(name, state.points, state.best_step, state.step)
    root = artifacts.write_artifacts(ctx.scratch, name, dataset, job, model, log)
    return Trained(files.tree(name, root), log)


def launch(job: Job[Batch], scratch: Path, devices: int, progress: Progress) -> None:
    """Complete the checkpoint in `scratch` with `devices` processes of torch.distributed.run.

    RuntimeError with the last output of the processes when they fail.
    """
    job_file, errors = scratch / "job.json", scratch / "errors.txt"
    job_file.write_text(job.to_json())
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(devices),
               "-m", distributed.__name__, str(job_file.absolute()), str(scratch.absolute())]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with errors.open("w") as stderr, subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=stderr,
                                                      text=True) as process:  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            done, _, total = line.partition(" ")
            if done.isdigit():
                progress(int(done), int(total))
    if process.returncode:
        raise RuntimeError(f"{devices} processes of torch.distributed.run: exit code {process.returncode}; their last output: "
                           f"{errors.read_text()[-600:]}")
