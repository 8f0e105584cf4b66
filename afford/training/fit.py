"""A job and a folder of samples -> a trained two-hand model, in this process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from afford.dataset.load import Item
from afford.models.twohands.build import build
from afford.models.twohands.model import TwoHands
from afford.training import cache, divide
from afford.training.batches import Batches, Boxes
from afford.training.hands import Hands, judged_batches
from afford.training.job import Job
from afford.training.loop import train
from afford.training.order import Order
from afford.training.ranks import ALONE, Ranks
from afford.training.sources import Files
from afford.training.state import State
from afford.training.task import Progress
from afford.training.views import Seen, cropped, whole


@dataclass(frozen=True)
class Fitted:
    """A model with its best weights, its threshold in its config, and how it came about."""

    model: TwoHands
    state: State


def prepare(job: Job, data: Files, scratch: Path) -> None:
    """Decode the samples of both parts once. ValueError when one of them has none."""
    largest = tuple(round(side * job.zoom) for side in job.config.size_px)
    for name in ("train", "val"):
        cache.write(divide.part(data, job.division, name), scratch / name, (largest[0], largest[1]))
        if not len(cache.Cache(scratch / name)):
            raise ValueError(f"data set: expected samples in the part {name}, found none; choose another split_by or val_fraction")


def fit(job: Job, scratch: Path, progress: Progress, ranks: Ranks = ALONE) -> Fitted:
    """Train, or go on where `scratch` says that an earlier process stopped. `prepare` comes first."""
    model = build(job.config, job.seed)
    state = train(_task(job, model, scratch, ranks.count), job.plan, scratch, progress, ranks)
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    if "val.threshold" in found:
        model.config = replace(job.config, threshold=found["val.threshold"])
    return Fitted(model, state)


def _task(job: Job, model: TwoHands, scratch: Path, processes: int) -> Hands:
    learned, boxes = cache.Cache(scratch / "train"), Boxes(job.config.size_px)
    order = Order([(row["verb"], row["taxonomy"]) for row in learned.rows], job.balance, job.seed)
    coarse = round(job.coarse_share * job.plan.steps) * job.plan.accumulate * processes
    batches = Batches(learned, order, job.views, boxes, job.batch, job.seed, coarse)
    judged = judged_batches(judges(cache.Cache(scratch / "val"), job), boxes, job.batch)
    return Hands(model, batches, judged, job.loss, job.target, job.plan.device)


def judges(samples: Sequence[Item], job: Job) -> list[Seen]:
    """Samples spread over all of them, every second one cropped to its objects."""
    count = min(job.val_samples, len(samples))
    chosen = [samples[round(n * (len(samples) - 1) / max(count - 1, 1))] for n in range(count)]
    return [cropped(item, job.views) if n % 2 else whole(item) for n, item in enumerate(chosen)]


def about(scratch: Path) -> dict[str, dict[str, Any]]:
    """What the two parts hold: samples, videos, verbs, nouns, taxonomy."""
    return {name: _about(cache.Cache(scratch / name).rows) for name in ("train", "val")}


def _about(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    sets = {name: len({row[name] for row in rows}) for name in ("video", "verb", "noun")}
    return {"samples": len(rows), **sets, "taxonomy": dict(sorted(Counter(row["taxonomy"] for row in rows).items()))}
