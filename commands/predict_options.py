"""What `predict` takes beside the picture and the task, for both kinds of models."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from commands.errors import UsageError, unknown


@dataclass(frozen=True)
class Options:
    """What was asked for beside the picture and the task."""

    out: Path
    model: Path | None = None
    hands: str = "auto"
    threshold: float | None = None
    all_hypotheses: bool = False
    every: int = 10
    batch: int | None = None
    device: str = "cpu"
    force: bool = False
    store: Path | None = None
    json: bool = False
    depth: Path | None = None
    intrinsics: Path | None = None
    focal_px: float | None = None
    rate_hz: float = 10.0
    frames: int = 10


def usable(device: str) -> str:
    """The device that was asked for. UsageError when there is none such."""
    if device not in ("cpu", "cuda"):
        raise unknown("--device", device, ("cpu", "cuda"))
    if device == "cuda":
        import torch

        if not torch.cuda.is_available():
            raise UsageError("--device cuda: expected a GPU that torch can use, got none; leave --device away")
    return device
