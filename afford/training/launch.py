"""Several devices: the standard launcher, one process for each, all of them started and waited for here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from afford.training import rank
from afford.training.job import Job
from afford.training.task import Batch, Progress

DATA_FILES = ()  # ROOT is where the processes start; nothing in it is read as data
ROOT = Path(__file__).resolve().parent.parent.parent


def launch(job: Job[Batch], scratch: Path, devices: int, progress: Progress) -> None:
    """Bring the checkpoint in `scratch` to its end with `devices` processes. RuntimeError with what they last said when they
    fail.
    """
    file, errors = scratch / "job.json", scratch / "errors.txt"
    file.write_text(job.to_json())
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(devices),
               "-m", rank.__name__, str(file.absolute()), str(scratch.absolute())]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with errors.open("w") as heard, subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=heard,
                                                     text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            done, _, total = line.partition(" ")
            if done.isdigit():
                progress(int(done), int(total))
    if process.returncode:
        raise RuntimeError(f"{devices} processes of torch.distributed.run: exit code {process.returncode}; the last they said: "
                           f"{errors.read_text()[-600:]}")
