"""XMem for video (Cheng and Schwing 2022): masks of key frames in, masks of every frame out.

The released checkpoint `XMem.pth` is loaded by its own names; sizes come from its tensors. Frames are scaled to a shorter side, as
in the released evaluation, and padded to multiples of 16 px.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, pad

from afford.models.frame_masks import FrameMasks
from afford.models.loading import MAX_SIZE, WEIGHTS, fill_weights, load_cached
from afford.models.normalise import normalised
from afford.models.tensor_files import read_tensors
from afford.models.xmem_memory import RELEASED, Memory, MemorySize
from afford.models.xmem_network import STRIDE_PX, Keys, XMem, XMemConfig

GIVE = "give XMem.pth as released, or a folder that `weights import xmem` wrote"
SIZED = {"width": "key_encoder.conv1.weight", "key_dim": "key_proj.key_proj.weight",
         "value_dim": "value_encoder.fuser.block2.conv2.weight",
         "hidden_dim": "decoder.hidden_update.transform.weight"}  # fmt: skip
"""size of the network -> tensor whose first dimension has it; that of the sensory memory three times"""
LEAST_PROBABILITY = 1e-7
"""probabilities are at least this far from 0 and 1"""


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> XMem:
    """Load a model for inference from `XMem.pth` as released, or a folder of `weights import`.

    ValueError, one sentence: no such file, another model, or tensors that are missing, extra or misshaped.
    """
    model: XMem = load_cached(_read, XMem, name, "xmem", device, dtype)
    return model


def _read(kind: Any, where: Path) -> XMem:
    path = where / WEIGHTS if where.is_dir() else where
    if not path.is_file():
        raise ValueError(f"{where}: expected {WEIGHTS} of XMem in this folder, got none; {GIVE}")
    given = read_tensors(path)
    with torch.device("meta"):
        model: XMem = kind(config_of(given, str(path)))
    fill_weights(model, given, str(path), GIVE)
    return model


def config_of(given: Mapping[str, Tensor], where: str) -> XMemConfig:
    """Sizes of the network of a checkpoint. ValueError names a tensor that another checkpoint lacks."""
    sizes = {}
    for field, name in SIZED.items():
        if name not in given:
            raise ValueError(f"{where}: expected a checkpoint of XMem, which has the tensor {name}, got {len(given)} others; "
                             f"{GIVE}")  # fmt: skip
        size = given[name].shape[0] if given[name].dim() else 0
        sizes[field] = size // 3 if field == "hidden_dim" else size
        if not 1 <= sizes[field] <= MAX_SIZE:
            raise ValueError(f"{where}: expected {name} with 1 to {MAX_SIZE} channels, got shape {tuple(given[name].shape)}; "
                             f"{GIVE}")  # fmt: skip
    return XMemConfig(**sizes)


@dataclass(frozen=True)
class Stored:
    """A key frame as it is in memory."""

    keys: Keys
    value: Tensor
    """(n, value_dim, h / 16, w / 16)"""


@dataclass(frozen=True)
class Session:
    """A video with its encoded key frames."""

    model: XMem
    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    short_side_px: int
    prompts: Mapping[int, Stored]
    """frame position -> key frame"""


@torch.inference_mode()
def session(model: XMem, rgb: np.ndarray, prompts: Mapping[int, np.ndarray], short_side_px: int = 480) -> Session:
    """Encode the key frames of a video. prompts: frame position -> (n, h, w) bool masks of all n objects, some perhaps empty.

    `short_side_px`: shorter side of frames in the network; masks are returned at the size of `rgb`.
    """
    made = Session(model, rgb, short_side_px, {})
    return Session(model, rgb, short_side_px, {at: _store(made, at, masks) for at, masks in sorted(prompts.items())})


def _store(made: Session, at: int, masks: np.ndarray) -> Stored:
    image = picture(made, at)
    keys, features = made.model.encode_key(image)
    given = torch.from_numpy(np.array(masks)).to(image.device).float()[:, None]
    scaled = padded(interpolate(given, _scaled(masks.shape[1:], made.short_side_px), mode="nearest"))[:, 0]
    return Stored(keys, made.model.encode_value(image, features, aggregate(scaled)[1:]))


def track_frames(made: Session, order: Sequence[int], *, every: int = 5, size: MemorySize = RELEASED,
                 alone: bool = False) -> Iterator[FrameMasks]:  # fmt: skip
    """Propagate the masks of the key frame `order[0]` through the following frames; yields the masks of each of them.

    Logits are those of an object against the background. All key frames of the session are in memory, with `alone` only the first.
    Every `every`-th frame is stored in memory. ValueError when `order` does not begin at a key frame.
    """
    if order[0] not in made.prompts:
        raise ValueError(f"a pass of XMem begins at a key frame, got frame {order[0]} and key frames {sorted(made.prompts)}")
    memory = Memory(size)
    for at, stored in made.prompts.items():
        if at == order[0] or not alone:
            memory.add(stored.keys, stored.value, pinned=True)
    value = made.prompts[order[0]].value
    hidden = value.new_zeros(len(value), made.model.config.hidden_dim, *value.shape[2:])
    with torch.inference_mode():
        hidden = made.model.deep_update(value, hidden)
    for step, at in enumerate(order[1:], 1):
        probability, hidden = _advance(made, at, memory, hidden, store=step % every == 0)
        yield FrameMasks(at, _logits(probability, made))


@torch.inference_mode()
def _advance(made: Session, at: int, memory: Memory, hidden: Tensor, *, store: bool) -> tuple[Tensor, Tensor]:
    """Segment a frame: probabilities (n + 1, H, W) at the size of the network, background first, and the next sensory memory.

    A frame that is stored updates the sensory memory by its value, other frames by the features of the decoder.
    """
    image = picture(made, at)
    keys, features = made.model.encode_key(image)
    read = memory.read(keys).to(hidden.dtype)
    logits, hidden = made.model.decoder(features, read, hidden, update=not store)
    probability = aggregate(logits.float().sigmoid())
    if store:
        value = made.model.encode_value(image, features, probability[1:])
        memory.add(keys, value)
        hidden = made.model.deep_update(value, hidden)
    return probability, hidden


def aggregate(probability: Tensor) -> Tensor:
    """Soft aggregation (Oh et al. 2019): probabilities (n + 1, h, w), background first, of n independent ones (n, h, w).

    The background is where no object is; odds are normalised to sum to 1.
    """
    every = torch.cat([(1 - probability).prod(dim=0, keepdim=True), probability])
    every = every.clamp(LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
    odds = every / (1 - every)
    return odds / odds.sum(dim=0, keepdim=True)


def _logits(probability: Tensor, made: Session) -> Tensor:
    """Log odds (n, h, w) against the background, at the size of the video and on the CPU."""
    size = made.rgb.shape[1:3]
    scaled = _scaled(size, made.short_side_px)
    left, _, top, _ = _margins(scaled)
    inner = probability[None, :, top : top + scaled[0], left : left + scaled[1]]
    log = interpolate(inner, size, mode="bilinear", align_corners=False)[0].clamp(min=LEAST_PROBABILITY).log()
    return (log[1:] - log[:1]).cpu()


def picture(made: Session, at: int) -> Tensor:
    """Frame (1, 3, H, W) of a video as the network's input: scaled, normalised and padded."""
    first = next(made.model.parameters())
    image = torch.from_numpy(np.array(made.rgb[at])).to(first.device).permute(2, 0, 1)[None].float() / 255
    size = _scaled(made.rgb.shape[1:3], made.short_side_px)
    return padded(interpolate(normalised(image), size, mode="bilinear", align_corners=False, antialias=True)).to(first.dtype)


def padded(image: Tensor) -> Tensor:
    """Pad the height and width of (b, c, h, w) by zeros to multiples of 16 px, equally on both sides."""
    return pad(image, _margins(image.shape[2:]))


def _scaled(size: Sequence[int], short_side_px: int) -> tuple[int, int]:
    """Height and width of frames in the network, without padding."""
    least = min(size)
    return int(size[0] * short_side_px / least), int(size[1] * short_side_px / least)


def _margins(size: Sequence[int]) -> tuple[int, int, int, int]:
    """Padding to the left, right, top and bottom."""
    height, width = (-side % STRIDE_PX for side in size)
    return width // 2, width - width // 2, height // 2, height - height // 2
