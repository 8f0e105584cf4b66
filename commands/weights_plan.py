"""The verb `weights plan`: memory that a large two-hand model needs to predict and to be trained, before anything is loaded."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from commands.errors import UsageError
from commands.settings import settings

if TYPE_CHECKING:
    from afford.twohands.model.memory_plan import MemoryPlan
    from stages.twohands.model_train import Params

TYPES = ("float32", "bfloat16")
PIPED_WIDTH = 140
"""width in columns without a terminal"""
PARTS = ("mapped", "weights", "gradients", "moments", "best", "work", "samples", "process")


def plan(folder: Path, device: str, batch: int, sets: Sequence[str], as_json: bool) -> int:
    """Print the plan of each use of a `vlm` model or of a folder of backbones. UsageError for another folder or setting."""
    if not all((folder / name / "config.json").is_file() for name in ("vlm", "sam")):
        raise UsageError(f"{folder}: expected a two-hand model of the variant vlm, or backbones, with vlm/config.json and "
                         "sam/config.json; `weights import` writes both")  # fmt: skip
    if device not in ("cpu", "cuda") or batch < 1:
        raise UsageError(f"expected --device cpu or cuda and --batch 1 or more, got {device} and {batch}")
    try:
        found = [*_predictions(folder, device, batch), *_trainings(folder, device, sets)]
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error
    if as_json:
        rows = [{"use": use, "device": device, "total": one.total / 2**30, **one.parts()} for use, one in found]
        sys.stdout.write(json.dumps({"folder": str(folder), "gib": rows}) + "\n")
        return 0
    table = Table("GiB on " + device, *PARTS, "total", box=None)
    for use, one in found:
        table.add_row(use, *(f"{one.parts().get(part, 0):.1f}" for part in PARTS), f"{one.total / 2**30:.1f}")
    Console(width=None if sys.stdout.isatty() else PIPED_WIDTH).print(table)
    return 0


def _predictions(folder: Path, device: str, batch: int) -> Iterator[tuple[str, MemoryPlan]]:
    """Plans of `predict` for a folder with the weights of a model; none for backbones."""
    from afford.twohands.model.large import plan_folder
    from afford.twohands.model.model_folder import format_of, read_config

    if format_of(folder) is None:
        return
    config = read_config(folder)
    for dtype in ("", *TYPES):
        yield f"predict{f' --dtype {dtype}' if dtype else ''} --batch {batch}", plan_folder(folder, config, dtype, device, batch)


def _trainings(folder: Path, device: str, sets: Sequence[str]) -> Iterator[tuple[str, MemoryPlan]]:
    """Plans of `model_train` as it is set, with its frozen weights in each type."""
    from transformers import SamConfig

    from afford.twohands.train.memory_plan import plan_training
    from stages.twohands.model_train import training_job

    size = SamConfig.from_pretrained(folder / "sam").vision_config.image_size
    words = ["model_train.variant=vlm", f"model_train.height_px={size}", f"model_train.width_px={size}", *sets]
    chosen: Params = replace(settings(words, None).twohands.model_train, backbones=str(folder), device=device)
    for dtype in TYPES if not any("frozen_dtype" in word for word in sets) else (chosen.frozen_dtype,):
        params = replace(chosen, frozen_dtype=dtype)
        yield f"train, batch {params.batch}, frozen_dtype={dtype}", plan_training(training_job(params))
