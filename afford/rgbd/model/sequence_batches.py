"""Batch number n of a training on RGB-D sequences: drawn, changed, stacked. A function of (seed, n), in any order."""

from __future__ import annotations

from collections.abc import Sequence as Listed
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
from afford.rgbd.model.inputs import Frames, Seen, frames
from afford.training.sampler import BalancedSampler

SMALLEST_CROP = 0.8
"""share of the side that a crop keeps"""


class Learned(NamedTuple):
    """b sequences, in groups of one length each, with what is true of their last frames."""

    groups: tuple[Frames, ...]
    label: Tensor
    """(b, h, w) int64"""
    action: Tensor
    """(b,) int64"""
    done: float = 1.0
    """share of the training that is done"""


@dataclass(frozen=True)
class Changes:
    """How often sequences are changed; all frames of one alike."""

    flip_share: float = 0.5
    crop_share: float = 0.8
    colour_share: float = 0.5


@dataclass(frozen=True)
class SequenceBatches:
    """`batches(n)` is batch n of `total`."""

    paths: Listed[Path]
    config: Sor3dConfig
    changes: Changes
    order: BalancedSampler
    size: int
    """sequences per batch"""
    static_share: float
    """the last frames of this share of a batch are learned beside it, as pictures in which nothing moves"""
    total: int
    seed: int
    coarse: int = 0
    """batches that come first, at half the size"""

    def __call__(self, number: int) -> Learned:
        chosen = self.drawn(number)
        pictures = [last(one) for one in chosen[: self.pictures]]
        return stack([chosen, pictures] if pictures else [chosen], self.config, number / self.total)

    @property
    def pictures(self) -> int:
        """Pictures beside a batch: none or at least two, for they are normalised over."""
        return max(2, round(self.size * self.static_share)) if self.static_share else 0

    def drawn(self, number: int) -> list[PackedSequence]:
        """The sequences of a batch."""
        side = self.config.size_px // 2 if number < self.coarse else self.config.size_px
        return [self._sample(number * self.size + n, side) for n in range(self.size)]

    def _sample(self, position: int, side: int) -> PackedSequence:
        _, index = self.order.sample(position)
        found = fitted(packed_sequences.read_sequence(self.paths[index], self.config.flow), side)
        return changed(found, self.changes, np.random.default_rng((self.seed, position, 2)))


def last(one: PackedSequence) -> PackedSequence:
    """The last frame as a picture."""
    return replace(one, rgb=one.rgb[-1:], depth_m=one.depth_m[-1:], flow=one.flow[:0])


def stack(groups: Listed[Listed[PackedSequence]], config: Sor3dConfig, done: float = 1.0) -> Learned:
    """Groups of sequences of one size, each of one length -> tensors."""
    seen = tuple(frames([Seen(one.rgb, one.depth_m, one.flow, one.still) for one in group], config) for group in groups)
    chosen = [one for group in groups for one in group]
    label = torch.from_numpy(np.stack([one.label for one in chosen]).astype(np.int64))
    return Learned(seen, label, torch.tensor([packed_sequences.affordance_index(one.affordance) for one in chosen]), done)


def fitted(one: PackedSequence, size_px: int) -> PackedSequence:
    """At the size of the model; it is square, so what is not is cut to its middle."""
    height, width = one.label.shape
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return window(one, top, left, side, size_px) if one.label.shape != (size_px, size_px) else one


def changed(one: PackedSequence, changes: Changes, rng: np.random.Generator) -> PackedSequence:
    """Cropped, mirrored and coloured by chance."""
    side = one.label.shape[0]
    if rng.random() < changes.crop_share:
        kept = round(side * rng.uniform(SMALLEST_CROP, 1))
        top, left = rng.integers(0, side - kept + 1, 2)
        one = window(one, int(top), int(left), kept, side)
    if rng.random() < changes.flip_share:
        one = mirrored(one)
    if rng.random() < changes.colour_share:
        gain, more = rng.uniform(0.75, 1.25, 3), rng.uniform(-25, 25)
        one = replace(one, rgb=np.clip(one.rgb * gain.astype(np.float32) + np.float32(more), 0, 255).astype(np.uint8))
    return one


def window(one: PackedSequence, top: int, left: int, side: int, size_px: int) -> PackedSequence:
    """A square of every frame, at another size; motion keeps its colours."""
    at, size = np.s_[top : top + side, left : left + side], (size_px, size_px)

    def resized(images: np.ndarray, how: int) -> np.ndarray:
        made = [cv2.resize(np.ascontiguousarray(image[at]), size, interpolation=how) for image in images]
        return np.stack(made) if made else np.zeros((0, *size, *images.shape[3:]), images.dtype)

    smooth = cv2.INTER_AREA if size_px < side else cv2.INTER_LINEAR
    return replace(one, rgb=resized(one.rgb, smooth), depth_m=resized(one.depth_m, cv2.INTER_NEAREST),
                   flow=resized(one.flow, cv2.INTER_NEAREST), label=resized(one.label[None], cv2.INTER_NEAREST)[0])  # fmt: skip


def mirrored(one: PackedSequence) -> PackedSequence:
    """Left is right, in space as well: motion along x turns round."""
    flow = one.flow[:, :, ::-1].copy()
    flow[..., 0] = np.clip(2 * int(one.still[0]) - flow[..., 0].astype(np.int16), 0, 255).astype(np.uint8)
    return replace(one, rgb=one.rgb[:, :, ::-1].copy(), depth_m=one.depth_m[:, :, ::-1].copy(), flow=flow,
                   label=one.label[:, ::-1].copy())  # fmt: skip
