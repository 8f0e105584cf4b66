"""One of several processes that train together: `python -m torch.distributed.run ... -m afford.training.rank JOB.json SCRATCH`.

The first one says on stdout how far it is, a line `step steps` each time.
"""

from __future__ import annotations

import sys
from pathlib import Path

from afford.training.fit import fit
from afford.training.job import read
from afford.training.ranks import launched
from afford.training.repeatable import repeatable


def main(job_file: Path, scratch: Path) -> None:
    """Train with the others until the checkpoint in `scratch` is complete."""
    job = read(job_file.read_text())
    with repeatable(1, job.plan.device), launched(job.plan.device) as ranks:

        def progress(done: int, total: int) -> None:
            if ranks.first:
                sys.stdout.write(f"{done} {total}\n")
                sys.stdout.flush()

        fit(job, scratch, progress, ranks)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
