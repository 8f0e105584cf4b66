"""LaMa, a feed-forward network that fills each frame alone, in one pass. Needs its published weights; a CPU will do.

Works at the frame's own size, mirrored up to multiples of 8 at the bottom and at the right; nothing is scaled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from afford.extraction.inpaint import Filled, LamaParams
from afford.extraction.inpaint.lama_network import GIVEN, Generator, LamaConfig
from afford.extraction.inpaint.windows import chunks, side_of, windows
from afford.models.loading import device_of, dtype_of, fill_weights
from afford.models.tensor_files import read_tensors
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

NEEDED = "LaMa's published checkpoint (best.ckpt), its TorchScript (big-lama.pt), or safetensors with the names of either"
INSIDE = "generator."
"""what stands before the generator's names in a checkpoint, and somewhere before them in TorchScript"""
FIRST = "model.1.ffc.convl2l.weight"


def load(name: str, device: torch.device, dtype: torch.dtype) -> Generator:
    """A model for inference, its sizes read off its tensors. ValueError, one sentence, when there is none or it does not fit."""
    path = Path(name)
    if not name or not path.is_file():
        got = f"got {name!r}, which is no file" if name else "got ''"
        raise ValueError(f"backend 'lama' needs a model: expected {NEEDED}, {got}; set hand_inpaint.lama.model")
    given = generator_tensors(read_tensors(path))
    with torch.device("meta"):
        model = Generator(config_of(given, str(path)))
    fill_weights(model, given, str(path), f"give {NEEDED}")
    return model.to(device, dtype).eval()


def generator_tensors(found: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The generator's tensors under their own names, wherever in the file they are; losses and discriminators are left out."""
    inside = {name.partition(INSIDE)[2]: tensor for name, tensor in found.items() if _in_generator(name)}
    return inside or dict(found)


def config_of(given: Mapping[str, Tensor], where: str) -> LamaConfig:
    """Sizes as the tensors have them; ValueError when they are not those of such a generator."""
    first = given.get(FIRST)
    if first is None or first.dim() != 4 or first.shape[1] != GIVEN:
        got = "none" if first is None else str(tuple(first.shape))
        raise ValueError(f"{where}: expected the tensor {FIRST} of shape (channels, {GIVEN}, 7, 7), got {got}; give {NEEDED}")
    blocks = {name.split(".")[1] for name in given if name.endswith(".conv1.ffc.convl2l.weight")}
    halvings = sum(1 for name in given if name.endswith(".ffc.convl2l.weight") and name.split(".")[2] == "ffc") - 1
    deep = first.shape[0] * 2**halvings
    wide = next((tensor.shape[0] for name, tensor in given.items() if name.endswith(".conv1.ffc.convl2g.weight")), 0)
    return LamaConfig(int(first.shape[0]), halvings, len(blocks), wide / deep)


def _in_generator(name: str) -> bool:
    before, found, _ = name.partition(INSIDE)
    return bool(found) and before in ("", "model.")


WEIGHTS = "LaMa's published checkpoint, a TorchScript file of it, or safetensors (docs/extraction/inpainting.md)"


class Job(NamedTuple):
    """One frame's hole in one part of it, (rows, columns)."""

    t: int
    area: tuple[slice, slice]


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: LamaParams) -> Filled:
    """See `Inpaint`. Confidence is 0: everything is guessed. With no hole at all no model is loaded."""
    side = side_of(params.window_px, 0)
    jobs = [Job(t, area) for t in range(len(hole)) for area in _areas(hole[t], side)]
    out = frames.rgb.copy()
    if jobs:
        model = load(params.model, device_of(params.device), dtype_of(params.dtype))
        for _, same in groupby(sorted(jobs, key=_shape), _shape):
            for batch in chunks(list(same), params.batch):
                _paint(model, frames.rgb, hole, batch, out)
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(out, source, np.zeros(hole.shape, np.uint8))


@torch.inference_mode()
def fill(model: Generator, rgb: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """(b, h, w, 3) uint8 pictures and (b, h, w) bool holes -> (b, h, w, 3) uint8; pixels outside the holes are the model's own."""
    first = next(model.parameters())
    height, width = rgb.shape[1:3]
    known = np.concatenate([np.where(holes[..., None], 0, rgb) / np.float32(255), holes[..., None].astype(np.float32)], -1)
    more = [(0, -length % model.config.multiple_px) for length in (height, width)]
    padded = np.pad(known, [(0, 0), *more, (0, 0)], "symmetric")
    found = model(torch.from_numpy(padded).permute(0, 3, 1, 2).to(first))[:, :, :height, :width]
    return (found.float().clamp(0, 1) * 255).round().byte().permute(0, 2, 3, 1).cpu().numpy()


def _areas(hole: np.ndarray, side: int) -> list[tuple[slice, slice]]:
    if side:
        return [window.inside(hole.shape) for window in windows(hole, side)]
    return [(slice(0, hole.shape[0]), slice(0, hole.shape[1]))] if hole.any() else []


def _shape(job: Job) -> tuple[int, int]:
    rows, columns = job.area
    return rows.stop - rows.start, columns.stop - columns.start


def _paint(model: Generator, rgb: np.ndarray, hole: np.ndarray, jobs: Sequence[Job], out: np.ndarray) -> None:
    answers = fill(model, np.stack([rgb[job.t][job.area] for job in jobs]), np.stack([hole[job.t][job.area] for job in jobs]))
    for job, answer in zip(jobs, answers, strict=True):
        inside = hole[job.t][job.area]
        out[job.t][job.area][inside] = answer[inside]
