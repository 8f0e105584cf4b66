"""A job and a data set -> a trained model with its card and curves: what every stage that trains does, whatever it trains."""

from __future__ import annotations

from afford.common import files
from afford.training import curves, fit, launch, written
from afford.training.job import Job
from afford.training.repeatable import repeatable
from afford.training.task import Batch
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Trained


def train(job: Job[Batch], dataset: FileTree, name: str, ctx: Context, threads: int, devices: int = 1) -> Trained:
    """Train in the scratch folder, where a killed training goes on; `devices` processes, each with a device of its own."""
    job.prepare({file.name: file.path for file in dataset.files}, ctx.scratch)
    if devices > 1:
        launch.launch(job, ctx.scratch, devices, ctx.progress)
    with repeatable(threads // job.plan.parallel, job.plan.device):
        fitted = fit.fit(job, ctx.scratch, ctx.progress)
    log = curves.log(name, fitted.state)
    root = written.write(ctx.scratch, name, dataset, job, fitted, log)
    return Trained(files.tree(name, root), log)
