"""Model inputs: sequences as normalised tensors, their augmentation, and training batches.

Frame i gets the motion from frame i - 1 to i; the first frame gets none. Batch n is a function of (seed, n), in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.model.config import Sor3dConfig
from afford.training.sampler import BalancedSampler

MEAN, SPREAD = np.array((0.485, 0.456, 0.406), np.float32), np.array((0.229, 0.224, 0.225), np.float32)
"""mean and standard deviation of ImageNet's colours, for encoders that were trained on it"""
STEP = 127.0
"""grey levels from no motion to full motion"""


class ModelInput(NamedTuple):
    """One sequence at the size of the model."""

    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    depth_m: np.ndarray
    """(t, h, w) float32 or float16; 0 is a hole, or no depth at all"""
    flow: np.ndarray
    """(t - 1, h, w, 3) uint8 colours of the motion that the model uses, in space or on the image; (0, ...) for none"""
    still: np.ndarray
    """(3,) uint8: the colour of no motion in `flow`"""


class InputBatch(NamedTuple):
    """Tensors of n sequences of t frames."""

    appearance: Tensor
    """(n, t, 4, h, w) float32: colours, depth"""
    motion: Tensor
    """(n, t, 3, h, w) float32, about -1..1; 0 is no motion"""

    def to(self, device: str) -> InputBatch:
        """Move the tensors to a device."""
        return InputBatch(self.appearance.to(device), self.motion.to(device))


def to_batch(clips: Sequence[ModelInput], config: Sor3dConfig) -> InputBatch:
    """Stack sequences of one length and size. ValueError when a flow does not fit its clip.

    Only the last line uses torch: batches are built in a thread, whose operations would wait for torch's threads of the
    training.
    """
    pairs = [(_appearance(clip, config), _motion(clip, config)) for clip in clips]
    return InputBatch(*(torch.from_numpy(np.stack(parts)) for parts in zip(*pairs, strict=True)))


def _appearance(clip: ModelInput, config: Sor3dConfig) -> np.ndarray:
    rgb = (clip.rgb.astype(np.float32) / 255 - MEAN) / SPREAD
    depth = relative_depth(clip.depth_m.astype(np.float32), config.depth_span_m)
    return np.concatenate([rgb.transpose(0, 3, 1, 2), depth[:, None]], 1)


def relative_depth(depth_m: np.ndarray, span_m: float) -> np.ndarray:
    """Depth relative to the median of the first frame, in spans, clipped to -1..1; holes and clips without depth are 0."""
    known = depth_m > 0
    middle = np.median(depth_m[0][known[0]]) if known[0].any() else np.median(depth_m[known]) if known.any() else 0.0
    return np.where(known, np.clip((depth_m - middle) / span_m, -1, 1), 0).astype(np.float32)


def _motion(clip: ModelInput, config: Sor3dConfig) -> np.ndarray:
    """Motion (t, 3, h, w): flow i - 1 at frame i, its magnitude raised to a power."""
    steps, height, width = clip.rgb.shape[:3]
    motion = np.zeros((steps, 3, height, width), np.float32)
    if len(clip.flow):
        if clip.flow.shape != (steps - 1, height, width, 3):
            raise ValueError(f"flow: expected {(steps - 1, height, width, 3)} for a clip of {steps} frames, got {clip.flow.shape}")
        colours = (clip.flow.astype(np.float32) - clip.still.astype(np.float32)) / STEP
        motion[1:] = (np.sign(colours) * np.abs(colours) ** np.float32(config.motion_power)).transpose(0, 3, 1, 2)
    return motion


SMALLEST_CROP = 0.8
"""smallest share of the side that a crop keeps"""


class TrainingBatch(NamedTuple):
    """b sequences, in groups of one length each, with the labels of their last frames."""

    groups: tuple[InputBatch, ...]
    label: Tensor
    """(b, h, w) int64"""
    action: Tensor
    """(b,) int64"""
    done: float = 1.0
    """finished share of the training"""


@dataclass(frozen=True)
class Augmentation:
    """Shares of sequences that are flipped, cropped and recoloured; all frames of a sequence alike."""

    flip_share: float = 0.5
    crop_share: float = 0.8
    colour_share: float = 0.5


@dataclass(frozen=True)
class SequenceBatches:
    """Training batches of sequences: `batches(n)` is batch n of `total`."""

    paths: Sequence[Path]
    config: Sor3dConfig
    changes: Augmentation
    order: BalancedSampler
    size: int
    """sequences per batch"""
    static_share: float
    """share of a batch whose last frames are added as pictures without motion"""
    total: int
    seed: int
    coarse: int = 0
    """number of first batches at half the size"""

    def __call__(self, number: int) -> TrainingBatch:
        """Batch `number`: sequences, and some of their last frames as pictures."""
        chosen = self.sequences_of(number)
        pictures = [last_frame(one) for one in chosen[: self.pictures]]
        return stack([chosen, pictures] if pictures else [chosen], self.config, number / self.total)

    @property
    def pictures(self) -> int:
        """Number of pictures in a batch: none, or at least two for batch normalisation."""
        return max(2, round(self.size * self.static_share)) if self.static_share else 0

    def sequences_of(self, number: int) -> list[PackedSequence]:
        """Draw and augment the sequences of a batch."""
        side = self.config.size_px // 2 if number < self.coarse else self.config.size_px
        return [self._sample(number * self.size + n, side) for n in range(self.size)]

    def _sample(self, position: int, side: int) -> PackedSequence:
        _, index = self.order.sample(position)
        found = fit_to_model(packed_sequences.read_sequence(self.paths[index], self.config.flow), side)
        return augment(found, self.changes, np.random.default_rng((self.seed, position, 2)))


def last_frame(one: PackedSequence) -> PackedSequence:
    """Last frame of a sequence as a picture."""
    return replace(one, rgb=one.rgb[-1:], depth_m=one.depth_m[-1:], flow=one.flow[:0])


def stack(groups: Sequence[Sequence[PackedSequence]], config: Sor3dConfig, done: float = 1.0) -> TrainingBatch:
    """Stack groups of sequences of one size, each group of one length."""
    seen = tuple(to_batch([ModelInput(one.rgb, one.depth_m, one.flow, one.still) for one in group], config) for group in groups)
    chosen = [one for group in groups for one in group]
    label = torch.from_numpy(np.stack([one.label for one in chosen]).astype(np.int64))
    return TrainingBatch(seen, label, torch.tensor([packed_sequences.affordance_index(one.affordance) for one in chosen]), done)


def fit_to_model(one: PackedSequence, size_px: int) -> PackedSequence:
    """Crop the middle square of a sequence and resize it to the model's size."""
    height, width = one.label.shape
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return crop_resize(one, top, left, side, size_px) if one.label.shape != (size_px, size_px) else one


def augment(one: PackedSequence, changes: Augmentation, rng: np.random.Generator) -> PackedSequence:
    """Crop, mirror and recolour a sequence at random."""
    side = one.label.shape[0]
    if rng.random() < changes.crop_share:
        kept = round(side * rng.uniform(SMALLEST_CROP, 1))
        top, left = rng.integers(0, side - kept + 1, 2)
        one = crop_resize(one, int(top), int(left), kept, side)
    if rng.random() < changes.flip_share:
        one = flip_sequence(one)
    if rng.random() < changes.colour_share:
        gain, more = rng.uniform(0.75, 1.25, 3), rng.uniform(-25, 25)
        one = replace(one, rgb=np.clip(one.rgb * gain.astype(np.float32) + np.float32(more), 0, 255).astype(np.uint8))
    return one


def crop_resize(one: PackedSequence, top: int, left: int, side: int, size_px: int) -> PackedSequence:
    """Crop a square of every frame and resize it; motion keeps its colours."""
    at, size = np.s_[top : top + side, left : left + side], (size_px, size_px)

    def resized(images: np.ndarray, how: int) -> np.ndarray:
        made = [cv2.resize(np.ascontiguousarray(image[at]), size, interpolation=how) for image in images]
        return np.stack(made) if made else np.zeros((0, *size, *images.shape[3:]), images.dtype)

    smooth = cv2.INTER_AREA if size_px < side else cv2.INTER_LINEAR
    return replace(one, rgb=resized(one.rgb, smooth), depth_m=resized(one.depth_m, cv2.INTER_NEAREST),
                   flow=resized(one.flow, cv2.INTER_NEAREST), label=resized(one.label[None], cv2.INTER_NEAREST)[0])  # fmt: skip


def flip_sequence(one: PackedSequence) -> PackedSequence:
    """Mirror a sequence left to right; motion along x changes its sign, in space as well."""
    flow = one.flow[:, :, ::-1].copy()
    flow[..., 0] = np.clip(2 * int(one.still[0]) - flow[..., 0].astype(np.int16), 0, 255).astype(np.uint8)
    return replace(one, rgb=one.rgb[:, :, ::-1].copy(), depth_m=one.depth_m[:, :, ::-1].copy(), flow=flow,
                   label=one.label[:, ::-1].copy())  # fmt: skip
