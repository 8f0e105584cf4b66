"""A trained model asked about sequences: affordance of every pixel of the last frame, action, attention."""

from __future__ import annotations

from collections.abc import Sequence as Listed
from functools import partial
from pathlib import Path

import numpy as np
import torch

from afford.dataset import packed_sequences
from afford.models.loading import one_thread
from afford.rgbd.model import files
from afford.rgbd.model.both_ways import both_ways
from afford.rgbd.model.found import Found
from afford.rgbd.model.inputs import Seen, frames
from afford.rgbd.model.sequence_batches import fitted
from schemas.interaction import InteractionClip, SceneFlow


class Predictor:
    """A model in evaluation mode."""

    def __init__(self, folder: Path, device: str = "cpu", mirror: bool = True) -> None:
        """`mirror`: the mirror image is asked about too, in twice the time. ValueError when `folder` holds no such model."""
        self.model, self.device = files.load(folder).to(device), device
        self.ask = partial(both_ways, self.model) if mirror else self.model
        self.config = self.model.config

    def seen(self, clip: InteractionClip, flow: SceneFlow | None) -> Seen:
        """A clip as the model sees it: its middle square, at the model's size. Without `flow` nothing moves. ValueError for the
        flow of another clip.
        """
        return self.sees(sequence_of(clip, flow, self.config.flow))

    def sees(self, sequence: packed_sequences.PackedSequence) -> Seen:
        """The same of a packed sequence that was read with the kind of motion that the model sees."""
        one = fitted(sequence, self.config.size_px)
        return Seen(one.rgb, one.depth_m, one.flow, one.still)

    def predict(self, seen: Seen) -> Found:
        """What is said of the last frame; a sequence of one frame is a picture."""
        return self.batch([seen])[0]

    def every_frame(self, seen: Seen) -> list[Found]:
        """What is said of each frame when the sequence ends there."""
        return [self.predict(until(seen, count)) for count in range(1, len(seen.rgb) + 1)]

    @torch.inference_mode()
    def batch(self, many: Listed[Seen]) -> list[Found]:
        """Sequences of one length, at once; on a CPU on one thread (see ../threads.py)."""
        with one_thread(self.device):
            said = self.ask(frames(many, self.config).to(self.device))
        probability, action = said.logits.softmax(1).float().cpu().numpy(), said.action.softmax(1).float().cpu().numpy()
        shares = [np.zeros((0, 0), np.float32)] * len(many)
        if said.attention is not None:
            found = said.attention[:, 0].float().cpu().numpy()
            shares = list(found / found.sum((1, 2), keepdims=True))
        return [Found(*one) for one in zip(probability, action, shares, strict=True)]


def sequence_of(clip: InteractionClip, flow: SceneFlow | None, kind: str) -> packed_sequences.PackedSequence:
    """A clip with its motion `2d`, `3d` or `none`; without `flow` nothing moves. ValueError for the flow of another clip."""
    colour, still = np.zeros((0, *clip.rgb.shape[1:]), np.uint8), np.zeros(3, np.uint8)
    if flow is not None and kind != "none":
        if flow.name != clip.name or len(flow.colour) != len(clip.rgb) - 1:
            raise ValueError(f"{clip.name}: expected its own scene flow with {len(clip.rgb) - 1} pairs, got {flow.name} with "
                             f"{len(flow.colour)}")
        colour, still = (flow.colour_px, flow.still[3:]) if kind == "2d" else (flow.colour, flow.still[:3])
    return packed_sequences.PackedSequence(
        clip.name, clip.object_type, clip.affordance, clip.rgb, clip.depth_m, colour, still, clip.label
    )


def until(seen: Seen, count: int) -> Seen:
    """The first `count` frames and the motion between them."""
    return Seen(seen.rgb[:count], seen.depth_m[:count], seen.flow[: count - 1], seen.still)


def last(seen: Seen) -> Seen:
    """The last frame as a picture, in which nothing moves."""
    return Seen(seen.rgb[-1:], seen.depth_m[-1:], seen.flow[:0], seen.still)
