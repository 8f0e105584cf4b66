"""Memory of a large two-hand model, planned before anything is loaded, and refused where the device has too little.

Counted are weights in the types in which they are kept, gradients and both moments of AdamW for what is trained, the copy of the
best weights, the peak of all that the model makes while it runs (`meta_memory`: activations, casts, the cache of a generated
answer), samples in memory, and the process itself. Not counted are pages of files that are read once, memory that a kernel takes
inside one operation, and small blocks that the allocator keeps; large ones it returns (`freed_memory`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from afford.models.freed_memory import return_freed_blocks
from afford.models.meta_memory import model_tensors, peak_bytes, tensor_bytes
from afford.twohands.model.interface import Batch
from afford.twohands.model.vlm import LONGEST_ANSWER, Dialogue, Vlm

GIB = 1 << 30
LIBRARIES, CONTEXT, WORKSPACE = 384 << 20, 536 << 20, 64 << 20
"""bytes of a process besides its model: anonymous memory of Python with its libraries; on a GPU the context of CUDA, and what torch
keeps there for matrix products (benchmarks/memory_plan.md; those of a GPU by one random model on an H200: other cards differ)"""
LARGE = 50_000_000
"""parameters from which a model is planned before it is loaded; smaller ones fit wherever this project runs"""
TASK = "pour tea from the kettle into the small cup with the handle"


@dataclass(frozen=True)
class MemoryPlan:
    """Bytes that a run takes on its device at its peak."""

    mapped: int = 0
    """weights that stay in their files; the system drops and reads their pages as it needs room"""
    weights: int = 0
    """weights in memory of their own"""
    gradients: int = 0
    moments: int = 0
    """state of AdamW"""
    best: int = 0
    """copy of the weights of the best validation, as far as they are trained"""
    work: int = 0
    """activations, temporary results and the cache of a generated answer, at their peak"""
    samples: int = 0
    """batches that wait, and the samples of validation"""
    process: int = LIBRARIES
    """the process itself"""

    @property
    def total(self) -> int:
        """Sum of all parts."""
        return self.mapped + self.process + self.needed

    @property
    def needed(self) -> int:
        """Free memory that a process which has loaded its libraries needs."""
        return self.weights + self.gradients + self.moments + self.best + self.work + self.samples

    def parts(self) -> dict[str, float]:
        """GiB of every part that is not empty."""
        return {name: size / GIB for name, size in vars(self).items() if size}


def plan_prediction(model: Vlm, device: str, pictures: int = 1, mapped: frozenset[str] = frozenset()) -> MemoryPlan:
    """Plan `Predictor` for a model on the device meta, whose parameters have the types in which they will be used.

    `pictures` share one forward pass. `mapped` are the names of the parameters that stay in their files.
    """
    size, inside = model.config.size_px, {name: tensor for name, tensor in model.state_dict().items() if name in mapped}
    image = torch.empty(pictures, 3, *size, device="meta")
    model.eval()
    with torch.no_grad():  # in inference mode, composite operations would not be seen in parts
        work = peak_bytes(lambda: _answer(model, image), model_tensors(model))
    kept = tensor_bytes(inside.values())
    return MemoryPlan(mapped=kept, weights=tensor_bytes(model_tensors(model)) - kept, work=work, process=process_bytes(device))


def _answer(model: Vlm, image: torch.Tensor) -> None:
    """Run what `Vlm.answer` runs, with a text of full length in place of a generated one."""
    talk = model._dialogue(Batch(image[:1], (TASK,)))
    ids = torch.cat([talk.ids, talk.ids.new_full((1, LONGEST_ANSWER), model.tokens.id("[SEG]"))], 1)
    talk = Dialogue(ids, torch.ones_like(ids, dtype=torch.bool), ids)
    found = model.vlm(input_ids=talk.ids, attention_mask=talk.keep.long(), pixel_values=model._pixels(image[:1]), use_cache=True,
                      output_hidden_states=True, logits_to_keep=1)  # fmt: skip
    state = found.hidden_states[-1][:, -1]
    del found
    model._regions(image, model.project(state.expand(len(image), -1))[:, None])


def is_large(model: nn.Module) -> bool:
    """Return True for a model that is planned before it is loaded."""
    return sum(parameter.numel() for parameter in model.parameters()) >= LARGE


def process_bytes(device: str) -> int:
    """Bytes that a process takes on its device before it has a model."""
    return LIBRARIES if torch.device(device).type == "cpu" else CONTEXT + WORKSPACE


def make_room(plan: MemoryPlan, device: str, where: str, remedies: Sequence[tuple[str, Callable[[], MemoryPlan]]]) -> None:
    """Have freed memory returned, as plans count it, or raise ValueError when a device has less free memory than a run needs.

    The message names the first of the `remedies` (what to do, and the plan that results) that fits, else the one that needs least.
    """
    return_freed_blocks()
    free = free_bytes(device)
    if free is None or plan.needed <= free:
        return
    tried = [(words, other().needed) for words, other in remedies]
    words, least = min(tried, key=lambda one: one[1], default=("", plan.needed))
    helps = next((words for words, needed in tried if needed <= free), None)
    more = f"free {min(least, plan.needed) / GIB:.1f} GiB" + (f" and {words}" if least < plan.needed else "")
    elsewhere = "" if torch.device(device).type == "cpu" else ", or use --device cpu"
    parts = ", ".join(f"{name} {size:.1f}" for name, size in plan.parts().items() if name not in ("mapped", "process"))
    raise ValueError(f"{where}: it needs {plan.needed / GIB:.1f} GiB on {device} ({parts}), and {free / GIB:.1f} GiB are free; "
                     f"{helps or more + elsewhere}")  # fmt: skip


def free_bytes(device: str) -> int | None:
    """Free memory of a device: of a GPU, or of this machine without what it can drop; None where the system does not say."""
    if torch.device(device).type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")), None)


def trained_bytes(model: nn.Module) -> int:
    """Bytes of the parameters that are trained."""
    return tensor_bytes(parameter for parameter in model.parameters() if parameter.requires_grad)
