"""Memory of the training of a large two-hand model, planned from its job before a weight is loaded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import torch

from afford.models.loading import dtype_of
from afford.models.meta_memory import model_tensors, peak_bytes, recomputed, tensor_bytes
from afford.training.loop import autocasts
from afford.twohands.model.frozen_weights import store_frozen
from afford.twohands.model.interface import Batch, Target, build
from afford.twohands.model.losses import losses
from afford.twohands.model.memory_plan import TASK, MemoryPlan, is_large, make_room, process_bytes, trained_bytes
from afford.twohands.model.vlm import Vlm
from afford.twohands.train.sample_stream import DECODED_BYTES

if TYPE_CHECKING:
    from afford.twohands.train.job import TwoHandsJob

WAITING = 6
"""micro-batches that are computed ahead, with the one in the making"""
SAMPLE_BYTES = 7
"""bytes of a sample for each pixel: an image and four masks"""


def plan_training(job: TwoHandsJob, train: int | None = None, val: int | None = None) -> MemoryPlan:
    """Plan a training of a `vlm` on the device of its plan; `train` and `val` are the numbers of samples, None for the most."""
    model = _model_of(job)
    mixed = torch.bfloat16 if autocasts(job.plan.device, job.plan.bf16) else None
    if job.checkpointing:
        model.vlm.gradient_checkpointing_enable({"use_reentrant": False, "context_fn": partial(recomputed, mixed)})
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(job.seed)
        peak = peak_bytes(lambda: _step(job, model), model_tensors(model), mixed)
    trained, weights = trained_bytes(model), tensor_bytes(model_tensors(model))
    best = trained if job.plan.validate_every else 0
    on_cpu = torch.device(job.plan.device).type == "cpu"
    return MemoryPlan(weights=weights, gradients=trained, moments=2 * trained, best=best, work=max(peak - trained, best),
                      samples=_sample_bytes(job, train, val) if on_cpu else 0, process=process_bytes(job.plan.device))  # fmt: skip


def _model_of(job: TwoHandsJob) -> Vlm:
    """The model of a job on the device meta."""
    with torch.device("meta"):
        model = build(job.config, job.seed, pretrained=False)
    if job.frozen_dtype != "float32":
        store_frozen(model, dtype_of(job.frozen_dtype))
    assert isinstance(model, Vlm)
    return model.train()


def _step(job: TwoHandsJob, model: Vlm) -> None:
    """Add the gradients of one micro-batch to those of an earlier one, if a step has several."""
    if job.plan.accumulate > 1:
        for parameter in model.parameters():
            parameter.grad = torch.zeros_like(parameter) if parameter.requires_grad else None
    count, size = job.batch, job.config.size_px
    with torch.device("meta"):
        image, masks = torch.empty(count, 3, *size), torch.empty(count, 2, *size)
    target = Target(masks, torch.ones(count, 2, dtype=torch.bool), torch.full((count,), 2))
    (losses(model(Batch(image, (TASK,) * count)), target, job.loss)["total"] / job.plan.accumulate).backward()


def _sample_bytes(job: TwoHandsJob, train: int | None, val: int | None) -> int:
    """Bytes of samples that are kept decoded, of batches that wait, and of validation samples with their predictions and truth."""
    pixels = job.config.size_px[0] * job.config.size_px[1]
    kept = DECODED_BYTES if train is None else min(DECODED_BYTES, round(train * SAMPLE_BYTES * pixels * job.zoom**2))
    ahead = (WAITING + job.plan.accumulate) * job.batch * SAMPLE_BYTES
    judged = SAMPLE_BYTES + (2 + 2 * 4 * job.config.hypotheses if job.plan.validate_every else 0)
    return kept + pixels * (ahead + judged * (job.val_samples if val is None else min(val, job.val_samples)))


def check_training(job: TwoHandsJob, train: int, val: int) -> None:
    """Make room for the training of a large `vlm`; ValueError when the device lacks memory names a setting that fits.

    `train` and `val` are the numbers of samples.
    """
    if not is_large(_model_of(job)):
        return
    where = f"model_train with {job.config.backbones or 'tiny backbones'}"
    make_room(plan_training(job, train, val), job.plan.device, where, _remedies(job, train, val))


def _remedies(job: TwoHandsJob, train: int, val: int) -> list[tuple[str, Callable[[], MemoryPlan]]]:
    """Settings that need less memory: each by itself, then all that came before together."""
    one = replace(job, batch=1, plan=replace(job.plan, accumulate=job.plan.accumulate * job.batch))
    steps = [("model_train.checkpointing=true", replace(job, checkpointing=True)), ("model_train.batch=1 with "
             f"model_train.accumulate={one.plan.accumulate}", one), ("model_train.frozen_dtype=bfloat16",
             replace(job, frozen_dtype="bfloat16"))]  # fmt: skip
    useful = [(words, changed) for words, changed in steps if changed != job]
    if len(useful) > 1:
        least = replace(job, checkpointing=True, batch=1, plan=one.plan, frozen_dtype="bfloat16")
        useful.append((" and ".join(words for words, _ in useful), least))
    return [(f"set {words}", partial(plan_training, changed, train, val)) for words, changed in useful]
