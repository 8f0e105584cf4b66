"""Inpaint with LaMa, a feed-forward network that fills each frame alone. Needs published weights; a CPU is sufficient.

Frames are padded by reflection to multiples of 8 at the bottom and at the right, and not scaled.
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
from afford.extraction.inpaint.lama_network import IN_CHANNELS, Generator, LamaConfig
from afford.extraction.inpaint.windows import chunks, side_of, windows
from afford.models.importing import Imported, parameter_count
from afford.models.importing.source import Source
from afford.models.loading import device_of, dtype_of, fill_weights
from afford.models.tensor_files import read_tensors
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

NEEDED = "LaMa's published checkpoint (best.ckpt), its TorchScript (big-lama.pt), or safetensors with the names of either"
INSIDE = "generator."
"""prefix of the names of the generator in a checkpoint; TorchScript may have more before it"""
FIRST = "model.1.ffc.convl2l.weight"


def load(name: str, device: torch.device, dtype: torch.dtype) -> Generator:
    """Load a generator for inference; its sizes come from its tensors. ValueError when the file is missing or does not fit."""
    path = Path(name)
    if not name or not path.is_file():
        got = f"got {name!r}, which is not a file" if name else "got ''"
        raise ValueError(f"backend 'lama' needs a model: expected {NEEDED}, {got}; set hand_inpaint.lama.model")
    given = generator_tensors(read_tensors(path))
    with torch.device("meta"):
        model = Generator(config_of(given, str(path)))
    fill_weights(model, given, str(path), f"give {NEEDED}")
    return model.to(device, dtype).eval()


def generator_tensors(found: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Select the tensors of the generator, under its own names; losses and discriminators are dropped."""
    inside = {name.partition(INSIDE)[2]: tensor for name, tensor in found.items() if _is_generator(name)}
    return inside or dict(found)


def config_of(given: Mapping[str, Tensor], where: str) -> LamaConfig:
    """Derive the sizes of the generator from its tensors; ValueError for tensors of another network."""
    first = given.get(FIRST)
    if first is None or first.dim() != 4 or first.shape[1] != IN_CHANNELS:
        got = "no such tensor" if first is None else str(tuple(first.shape))
        raise ValueError(f"{where}: expected the tensor {FIRST} of shape (channels, {IN_CHANNELS}, 7, 7), got {got}; give {NEEDED}")
    blocks = {name.split(".")[1] for name in given if name.endswith(".conv1.ffc.convl2l.weight")}
    halvings = sum(1 for name in given if name.endswith(".ffc.convl2l.weight") and name.split(".")[2] == "ffc") - 1
    deep = first.shape[0] * 2**halvings
    wide = next((tensor.shape[0] for name, tensor in given.items() if name.endswith(".conv1.ffc.convl2g.weight")), 0)
    return LamaConfig(int(first.shape[0]), halvings, len(blocks), wide / deep)


def _is_generator(name: str) -> bool:
    before, found, _ = name.partition(INSIDE)
    return bool(found) and before in ("", "model.")


WEIGHTS = "LaMa's published checkpoint, a TorchScript file of it, or safetensors (docs/extraction/inpainting.md)"
MET = "published size, random weights, 2026-11: 2,569 ms a frame of 456 x 256 px on one core; published names and shapes"


class HoleRegion(NamedTuple):
    """The hole of one frame inside a region of it."""

    t: int
    area: tuple[slice, slice]
    """rows and columns of the region"""


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: LamaParams) -> Filled:
    """Inpaint with LaMa, see `Inpaint`. Confidence is 0. Without a hole no model is loaded."""
    side = side_of(params.window_px, 0)
    jobs = [HoleRegion(t, area) for t in range(len(hole)) for area in _regions(hole[t], side)]
    out = frames.rgb.copy()
    if jobs:
        model = load(params.model, device_of(params.device), dtype_of(params.dtype))
        for _, same in groupby(sorted(jobs, key=_region_shape), _region_shape):
            for batch in chunks(list(same), params.batch):
                _fill_batch(model, frames.rgb, hole, batch, out)
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(out, source, np.zeros(hole.shape, np.uint8))


@torch.inference_mode()
def fill(model: Generator, rgb: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """Fill holes (b, h, w) bool of pictures (b, h, w, 3) uint8; pixels outside the holes are also output of the network."""
    first = next(model.parameters())
    height, width = rgb.shape[1:3]
    known = np.concatenate([np.where(holes[..., None], 0, rgb) / np.float32(255), holes[..., None].astype(np.float32)], -1)
    more = [(0, -length % model.config.multiple_px) for length in (height, width)]
    padded = np.pad(known, [(0, 0), *more, (0, 0)], "symmetric")
    found = model(torch.from_numpy(padded).permute(0, 3, 1, 2).to(first))[:, :, :height, :width]
    return (found.float().clamp(0, 1) * 255).round().byte().permute(0, 2, 3, 1).cpu().numpy()


def _regions(hole: np.ndarray, side: int) -> list[tuple[slice, slice]]:
    if side:
        return [window.inside(hole.shape) for window in windows(hole, side)]
    return [(slice(0, hole.shape[0]), slice(0, hole.shape[1]))] if hole.any() else []


def _region_shape(job: HoleRegion) -> tuple[int, int]:
    rows, columns = job.area
    return rows.stop - rows.start, columns.stop - columns.start


def _fill_batch(model: Generator, rgb: np.ndarray, hole: np.ndarray, jobs: Sequence[HoleRegion], out: np.ndarray) -> None:
    answers = fill(model, np.stack([rgb[job.t][job.area] for job in jobs]), np.stack([hole[job.t][job.area] for job in jobs]))
    for job, answer in zip(jobs, answers, strict=True):
        inside = hole[job.t][job.area]
        out[job.t][job.area][inside] = answer[inside]


def import_lama(source: Source) -> Imported:
    """Read a checkpoint of LaMa (`afford.models.importing.Kind`)."""
    given = generator_tensors(source.tensors)
    with torch.device("meta"):
        model = Generator(config_of(given, ", ".join(path.name for path in source.files)))
    counters = {name for name in model.state_dict() if name.endswith(".num_batches_tracked")}
    expected = {name: tensor for name, tensor in model.state_dict().items() if name in given or name not in counters}
    statistics = ("running_mean", "running_var", "num_batches_tracked")
    return Imported("LaMa", "--set hand_inpaint.backend=lama --set hand_inpaint.lama.model=DIR/model.safetensors", {}, given,
                    expected, single=True, counted=parameter_count(given, statistics))
