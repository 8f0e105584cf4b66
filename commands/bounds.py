"""What a value may be beside its type: finite, no less than a unit allows, one of the words that a stage knows."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable
from typing import Any

from commands.errors import UsageError, unknown

NOT_NEGATIVE = ("_px", "_px855", "_s", "_frames", "_hz", "_share", "_mm", "_fraction", "seed", "radius")
"""ends of names of what is 0 at least"""
POSITIVE = ("width_px", "height_px", "size_px", "side_px", "atlas_px", "texture_px", "focal_px", "rate_hz", "batch",
            "stride_frames", "supersample")  # fmt: skip
"""ends of names of what cannot be 0 either"""
TRAINING = ("steps", "accumulate", "devices", "val_samples", "hypotheses")
"""parameters of a training that are 1 at least"""
SEQUENCES = ("sor3d_train", "sor3d_pretrain", "boxes_train")
"""trainings on RGB-D sequences"""
TRAININGS = ("model_train", *SEQUENCES)
DEVICE = re.compile(r"cpu|cuda(:\d+)?")
WORDS: dict[tuple[str, str], tuple[str, ...]] = {
    ("dataset_pack", "split_by"): ("video", "participant"),
    ("dataset_pack", "made"): ("extracted", "rendered"),
    ("model_train", "variant"): ("small", "clip", "vlm"),
    ("model_train", "target"): ("affordance", "object"),
    ("model_train", "split_by"): ("given", "video", "object"),
    ("model_train", "loss_mode"): ("paper", "code"),
    ("model_train", "mask_loss"): ("", "bce", "focal"),
    **{(stage, "variant"): ("small", "paper") for stage in SEQUENCES},
    **{(stage, "row"): ("rgb", "rgb_attention", "rgb_attention_flow2d", "rgbd", "rgbd_attention", "rgbd_attention_flow3d")
       for stage in SEQUENCES},
}
"""file of a stage, parameter -> the words that it knows, where no registry of the stage lists them"""
EVERYWHERE: dict[str, tuple[str, ...]] = {
    "dtype": ("float32", "bfloat16", "float16"),
    "engine": ("bullet", "mujoco"), "engines": ("bullet", "mujoco"), "proof_engines": ("bullet", "mujoco"),
}  # fmt: skip
"""parameters that know the same words in every stage"""


def check(stage: str, name: str, value: Any, params: Any) -> None:
    """UsageError when a parameter of `stage` cannot be `value`, of its type already; `params` are those that it becomes one of."""
    module = type(params).__module__
    file = module.rpartition(".")[2]
    known = WORDS.get((file, name)) or EVERYWHERE.get(name) or vars(sys.modules[module]).get(registry(name))
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, str):
            _word(stage, name, one, known)
        elif not isinstance(one, bool):
            _number(f"{stage}.{name}", name, one, file in TRAININGS and name in TRAINING)


def registry(name: str) -> str:
    """The constant of a stage that lists what a parameter chooses from: backend -> BACKENDS, policy -> POLICIES."""
    return (name.removesuffix("y") + "ies" if name.endswith("y") else name + "s").upper()


def _word(stage: str, name: str, word: str, known: Iterable[str] | None) -> None:
    if known and word not in known:
        raise unknown(f"{name} of {stage}", word, known)
    if name == "device" and not DEVICE.fullmatch(word):
        raise UsageError(f"{stage}.{name}: expected cpu, cuda or cuda:N, got {word!r}")


def _number(where: str, name: str, number: float, counted: bool) -> None:
    if not math.isfinite(number):
        raise UsageError(f"{where}: expected a finite number, got {number}")
    if counted or name.endswith(POSITIVE):
        if number <= 0:
            raise UsageError(f"{where}: expected {'1 or more' if isinstance(number, int) else 'more than 0'}, got {number}")
    elif name.endswith(NOT_NEGATIVE) and number < 0:
        raise UsageError(f"{where}: expected 0 or more, got {number}")
    if name.endswith("_fraction") and number >= 1:
        raise UsageError(f"{where}: expected a share below 1, got {number}")
